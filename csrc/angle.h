/* Angles in radians: wrapping, averaging on the circle, and the course between two positions. */
#ifndef ANGLE_H
#define ANGLE_H

#define ANGLE_PI 3.14159265358979323846
#define ANGLE_DEGREE (ANGLE_PI / 180.0)

/* The same angle in (-pi, pi]; NaN stays NaN. */
double angle_wrap(double angle);

/* The same angle in [0, 2 pi); NaN stays NaN. */
double angle_wrap_positive(double angle);

/* Radians as degrees in [0, 360). */
double angle_to_bearing_deg(double angle);

/* Mean direction of n angles with non-negative weights, (-pi, pi]. NaN when the weights sum to nothing or the directions
 * cancel (a resultant below 1e-9 of the weights). Angles of weight 0 are not looked at. */
double angle_circular_mean(const double *angle, const double *weight, int n);

/* Course (rad, [0, 2 pi)) at the current position of the great circle that came from the previous one: the 2018 paper's
 * (1) in a form that does not cancel over short baselines. Positions in degrees, as receivers give them: their difference
 * is exact, where that of radians would lose 1e-5 degrees of course over 1 cm. NaN for equal positions. */
double angle_forward_azimuth(double lat_prev_deg, double lon_prev_deg, double lat_curr_deg, double lon_curr_deg);

#endif
