#include "angle.h"

#include <math.h>

static const double two_pi = 2.0 * ANGLE_PI;
static const double cancelled = 1e-9; /* resultant per weight below which a mean has no direction */

double angle_wrap(double angle)
{
    if (angle > -ANGLE_PI && angle <= ANGLE_PI) {
        return angle;
    }
    const double wrapped = remainder(angle, two_pi);
    return wrapped <= -ANGLE_PI ? ANGLE_PI : wrapped;
}

double angle_wrap_positive(double angle)
{
    const double wrapped = angle_wrap(angle);
    if (wrapped >= 0.0) {
        return wrapped;
    }
    const double positive = wrapped + two_pi;
    return positive >= two_pi ? 0.0 : positive; /* a tiny negative rounds up to the full circle */
}

double angle_to_bearing_deg(double angle)
{
    const double degrees = angle_wrap_positive(angle) / ANGLE_DEGREE;
    return degrees >= 360.0 ? 0.0 : degrees;
}

double angle_circular_mean(const double *angle, const double *weight, int n)
{
    double sum_sin = 0.0;
    double sum_cos = 0.0;
    double sum_weight = 0.0;
    for (int i = 0; i < n; i++) {
        if (weight[i] > 0.0) {
            sum_sin += weight[i] * sin(angle[i]);
            sum_cos += weight[i] * cos(angle[i]);
            sum_weight += weight[i];
        }
    }
    if (!(sum_weight > 0.0) || !(hypot(sum_sin, sum_cos) > cancelled * sum_weight)) {
        return NAN;
    }
    return angle_wrap(atan2(sum_sin, sum_cos));
}

double angle_forward_azimuth(double lat_prev_deg, double lon_prev_deg, double lat_curr_deg, double lon_curr_deg)
{
    const double turn = remainder(lon_prev_deg - lon_curr_deg, 360.0);
    const double d_lon = (turn <= -180.0 ? 180.0 : turn) * ANGLE_DEGREE;
    const double d_lat = (lat_prev_deg - lat_curr_deg) * ANGLE_DEGREE;
    if (d_lon == 0.0 && d_lat == 0.0) {
        return NAN;
    }
    const double cos_prev = cos(lat_prev_deg * ANGLE_DEGREE);
    const double half = sin(0.5 * d_lon);
    const double east = sin(d_lon) * cos_prev;
    const double north = sin(d_lat) + 2.0 * sin(lat_curr_deg * ANGLE_DEGREE) * cos_prev * half * half;
    return angle_wrap_positive(atan2(east, north) + ANGLE_PI);
}
