#include "stuck.h"

#include <math.h>

#include "angle.h"

static const int64_t frozen_us = 1000000;
static const int frozen_samples = 20;
static const double turned_most = 10.0 * ANGLE_DEGREE;
static const double turned_memory_s = 10.0; /* a gyro's bias of less than 1 deg/s never adds up to turned_most */

void stuck_imu_reset(stuck_imu_t *imu)
{
    *imu = (stuck_imu_t){.reading = {NAN, NAN, NAN, NAN, NAN, NAN}};
}

void stuck_compass_reset(stuck_compass_t *compass)
{
    *compass = (stuck_compass_t){.reading = NAN};
}

int stuck_imu_take(stuck_imu_t *imu, const imu_reading_t *reading, int64_t t_us)
{
    int same = 1;
    for (int i = 0; i < 3; i++) {
        same &= imu->reading[i] == reading->gyro_dps[i] && imu->reading[i + 3] == reading->accel_g[i];
        imu->reading[i] = reading->gyro_dps[i];
        imu->reading[i + 3] = reading->accel_g[i];
    }
    if (!same) {
        imu->since_us = t_us;
        imu->n = 0;
    }
    imu->n += imu->n < frozen_samples;
    return imu->n == frozen_samples && t_us - imu->since_us >= frozen_us;
}

int stuck_compass_take(stuck_compass_t *compass, double heading_deg)
{
    if (heading_deg != compass->reading) {
        compass->reading = heading_deg;
        compass->turned = 0.0;
        compass->stuck = 0;
    }
    compass->stuck |= fabs(compass->turned) > turned_most;
    return compass->stuck;
}

void stuck_compass_turn(stuck_compass_t *compass, double angle, double dt)
{
    compass->turned += angle - compass->turned * dt / turned_memory_s;
}
