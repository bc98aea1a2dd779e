/* One of the card's filters: the heading model in time, from its first heading on. */
#ifndef HEADING_FILTER_H
#define HEADING_FILTER_H

#ifndef TINYEKF_CDEF
#include <stdint.h>
#endif

#include "angle.h"
#include "heading_model.h"

typedef struct {
    double q[3];  /* process noise per second: m^2, m^2, rad^2 */
    double r[3];  /* measurement noise: m^2, m^2, rad^2 */
    double p0[3]; /* first covariance: m^2, m^2, rad^2 */
} heading_noise_t;

/* The papers' values: Q = diag(0.01, 0.01, 10), R = diag(0.3, 0.07, 0.03), P0 = diag(10, 10, 100), in m^2 and deg^2. */
#define HEADING_DEG2 (ANGLE_DEGREE * ANGLE_DEGREE)
#define HEADING_NOISE_PAPER                                                                                            \
    {                                                                                                                  \
        .q = {0.01, 0.01, 10.0 * HEADING_DEG2}, .r = {0.3, 0.07, 0.03 * HEADING_DEG2}, .p0 = {                         \
            10.0,                                                                                                      \
            10.0,                                                                                                      \
            100.0 * HEADING_DEG2                                                                                       \
        }                                                                                                              \
    }

typedef struct {
    ekf_t ekf;
    int64_t t_us; /* time of the state */
    int running;
    int has_position;
    int64_t position_us; /* stamp of the last position taken */
    double nis;          /* sum of the normalised innovations squared of the headings taken, */
    int headings;        /* and their number */
} heading_filter_t;

/* Forgets the state. */
void heading_filter_reset(heading_filter_t *filter);

/* Predicts to t with surge u (m/s) and yaw rate r (rad/s); nothing when not running or not later. */
void heading_filter_advance(heading_filter_t *filter, int64_t t_us, double u, double r, const heading_noise_t *noise);

/* Takes z = [north m, east m, heading rad], NaN where missing, at the filter's time. The first finite heading starts the
 * filter at t_us; the first position after a start without one, or after 10 s without, is taken as it is. */
ekf_status_t heading_filter_measure(heading_filter_t *filter, int64_t t_us, const double z[3],
                                    const heading_noise_t *noise);

/* Turns the heading by an angle (rad) without touching its covariance. */
void heading_filter_turn(heading_filter_t *filter, double angle);

#endif
