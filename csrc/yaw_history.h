/* The gyro's yaw of the last two seconds or so: the yaw rate integrated from the start, as measured, bias and all. Sensors that
 * report late (a GPS 60 to 200 ms) are compared with what the boat did then. */
#ifndef YAW_HISTORY_H
#define YAW_HISTORY_H

#ifndef TINYEKF_CDEF
#include <stdint.h>
#endif

#define YAW_HISTORY_LENGTH 256 /* entries at least 8 ms apart: two seconds and more */

typedef struct {
    int64_t t_us[YAW_HISTORY_LENGTH];
    double yaw[YAW_HISTORY_LENGTH];  /* rad, never wrapped */
    double rate[YAW_HISTORY_LENGTH]; /* rad/s, of the interval before the entry */
    int newest;                      /* index of the newest entry */
    int n;                           /* entries held */
} yaw_history_t;

void yaw_history_reset(yaw_history_t *history);

/* Turns by an angle (rad) up to t_us, at the rate (rad/s) that held. */
void yaw_history_turn(yaw_history_t *history, int64_t t_us, double angle, double rate);

/* Whether the gyro still says at t_us how the boat turns. */
int yaw_history_is_live(const yaw_history_t *history, int64_t t_us);

/* Yaw (rad) at a moment, with the newest rate a little beyond the newest entry; *rate (may be null) gets the rate. 0 when
 * there is no entry. */
double yaw_history_at(const yaw_history_t *history, int64_t t_us, double *rate);

#endif
