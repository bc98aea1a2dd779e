/* Sensors that stick at one value: they go on talking, and what they say is not so. docs/fusion.md has the rules. */
#ifndef STUCK_H
#define STUCK_H

#include "ground_velocity.h"
#include "sample.h"

/* An IMU is frozen when it repeats all its numbers: noise alone would change one. */
typedef struct {
    double reading[6]; /* gyro and accelerometer, of the last sample */
    int64_t since_us;  /* stamp of the first sample with this reading */
    int n;             /* how many had it */
} stuck_imu_t;

/* How one receiver saw the boat's way turn while the compass repeated its reading. */
typedef struct {
    ground_track_t track;
    ground_velocity_t now;  /* of the last seconds */
    ground_velocity_t then; /* when the compass began to repeat itself and the boat had way; follows slowly */
    int64_t now_us;         /* stamp of the last velocity; SOURCE_NEVER: none yet */
    int64_t then_us;        /* since when the boat has had way; SOURCE_NEVER: has none */
    int64_t against_us;     /* since when this denies the compass; SOURCE_NEVER: does not */
} stuck_course_t;

/* A compass is stuck when it repeats its reading while the boat turns; at the quay it may do so for hours. */
typedef struct {
    double reading; /* degrees, of the last sample */
    double turned;  /* rad: by the gyro since the first sample with this reading, forgotten slowly */
    stuck_course_t course[SAMPLE_MAX_GPS];
    int stuck;
} stuck_compass_t;

void stuck_imu_reset(stuck_imu_t *imu);
void stuck_compass_reset(stuck_compass_t *compass);

/* Whether a reading is the last one again; talks_on: the compass has not been silent since. */
int stuck_compass_repeats(const stuck_compass_t *compass, double heading_deg, int talks_on);

/* Notes a reading. Whether the sensor is stuck. */
int stuck_imu_take(stuck_imu_t *imu, const imu_reading_t *reading, int64_t t_us);
int stuck_compass_take(stuck_compass_t *compass, double heading_deg, int talks_on);

/* The boat turned by an angle (rad) within dt seconds. */
void stuck_compass_turn(stuck_compass_t *compass, double angle, double dt);

/* Receiver i gave a fix while the compass showed a true heading (rad; NaN: none). */
void stuck_compass_move(stuck_compass_t *compass, int64_t t_us, int i, const gps_reading_t *gps, double heading);

/* Whether the way that receiver i has lately seen denies what the compass repeats. */
int stuck_compass_is_denied(const stuck_compass_t *compass, int64_t t_us, int i);

#endif
