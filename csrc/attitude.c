#include "attitude.h"

#include <math.h>

#include "angle.h"

static const double time_constant_s = 5.0; /* gyro below, gravity above: a turn's acceleration is no heel */
static const double longest_gap_s = 1.0;   /* integrated over; after a longer one gravity starts anew */
static const double least_gravity_g = 0.1; /* free fall has no direction */
static const double steepest_pitch = 80.0 * ANGLE_DEGREE;

void attitude_reset(attitude_t *attitude)
{
    *attitude = (attitude_t){.needs_level = 1};
}

static void integrate(attitude_t *attitude, const double gyro[3], double dt)
{
    const double s = sin(attitude->roll);
    const double c = cos(attitude->roll);
    attitude->roll += dt * (gyro[0] + tan(attitude->pitch) * (gyro[1] * s + gyro[2] * c));
    attitude->pitch += dt * (gyro[1] * c - gyro[2] * s);
}

static void level(attitude_t *attitude, const double gravity[3], double dt)
{
    const double roll = atan2(gravity[1], gravity[2]);
    const double pitch = atan2(-gravity[0], hypot(gravity[1], gravity[2]));
    const double share = attitude->needs_level ? 1.0 : dt / (time_constant_s + dt);
    attitude->roll += share * angle_wrap(roll - attitude->roll);
    attitude->pitch += share * (pitch - attitude->pitch);
    attitude->levelled = 1;
    attitude->needs_level = 0;
}

double attitude_update(attitude_t *attitude, const double gyro[3], const double gravity[3], double dt)
{
    if (!isfinite(gyro[0] + gyro[1] + gyro[2])) {
        return NAN;
    }
    const double norm = sqrt(gravity[0] * gravity[0] + gravity[1] * gravity[1] + gravity[2] * gravity[2]);
    if (dt > longest_gap_s) {
        attitude->needs_level = 1;
        dt = 0.0;
    }
    if (attitude->levelled && dt > 0.0) {
        integrate(attitude, gyro, dt);
    }
    if (norm > least_gravity_g && norm < INFINITY) {
        level(attitude, gravity, dt);
    }
    attitude->roll = angle_wrap(attitude->roll);
    attitude->pitch = fmin(fmax(attitude->pitch, -steepest_pitch), steepest_pitch);
    return (gyro[1] * sin(attitude->roll) + gyro[2] * cos(attitude->roll)) / cos(attitude->pitch);
}
