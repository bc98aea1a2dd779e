/* Sensors that stick at one value: they go on talking, and what they say is not so. docs/fusion.md has the rules. */
#ifndef STUCK_H
#define STUCK_H

#include "sample.h"

/* An IMU is frozen when it repeats all its numbers: noise alone would change one. */
typedef struct {
    double reading[6]; /* gyro and accelerometer, of the last sample */
    int64_t since_us;  /* stamp of the first sample with this reading */
    int n;             /* how many had it */
} stuck_imu_t;

/* A compass is stuck when it repeats its reading while the boat turns; at the quay it may do so for hours. */
typedef struct {
    double reading; /* degrees, of the last sample */
    double turned;  /* rad: by the gyro since the first sample with this reading, forgotten slowly */
    int stuck;
} stuck_compass_t;

void stuck_imu_reset(stuck_imu_t *imu);
void stuck_compass_reset(stuck_compass_t *compass);

/* Notes a reading. Whether the sensor is stuck. */
int stuck_imu_take(stuck_imu_t *imu, const imu_reading_t *reading, int64_t t_us);
int stuck_compass_take(stuck_compass_t *compass, double heading_deg);

/* The boat turned by an angle (rad) within dt seconds. */
void stuck_compass_turn(stuck_compass_t *compass, double angle, double dt);

#endif
