/* Roll, pitch and the rate of turn from gyro and gravity (design §3). Body axes: x forward, y starboard, z down. */
#ifndef ATTITUDE_H
#define ATTITUDE_H

typedef struct {
    double roll;     /* rad, starboard down positive */
    double pitch;    /* rad, bow up positive */
    int levelled;    /* gravity has been seen */
    int needs_level; /* take the next gravity as it is: at the start, and after a gap */
} attitude_t;

void attitude_reset(attitude_t *attitude);

/* Takes gyro (rad/s) and gravity (g, level at rest (0, 0, +1); NaN: none) dt seconds after the sample before (0 for the
 * first) through a complementary filter, and returns the rate of turn (rad/s, to starboard positive; NaN when the gyro
 * is missing). */
double attitude_update(attitude_t *attitude, const double gyro[3], const double gravity[3], double dt);

#endif
