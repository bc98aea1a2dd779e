#include "stuck.h"

#include <math.h>

#include "angle.h"
#include "source_clock.h"

static const int64_t frozen_us = 1000000;
static const int frozen_samples = 20;
static const double turned_most = 10.0 * ANGLE_DEGREE;
static const double turned_memory_s = 10.0; /* a gyro's bias of less than 1 deg/s never adds up to turned_most */

static const double velocity_memory_s = 2.0; /* waves swing an antenna */
static const double velocity_gap_s = 5.0;    /* an older velocity is no part of the mean */
static const double velocity_most = 100.0;   /* m/s: no boat */
static const double under_way = 1.0;         /* m/s: from here on she has a course */
static const double no_way = 0.5;            /* m/s: from here down she has none */
static const int64_t settling_us = 5000000;  /* after a turn the course still comes round, behind the compass */
static const double then_memory_s = 120.0;   /* a current may change as slowly */
static const int64_t denied_us = 3000000;
static const double off_axis_most = 30.0 * ANGLE_DEGREE; /* how far she may be driven off what a sound compass shows, */
static const double off_axis_seen = 8.0 * ANGLE_DEGREE;  /* and how far beyond what was seen of it */
static const double current_change = 0.7;                /* m/s, meanwhile */
static const double leeway_change = 0.15;                /* of the speed */
static const double sigmas = 4.0;
static const double velocity_sigma = 0.08; /* m/s per axis, at HDOP 1: of what a receiver says, and */
static const double position_sigma = 0.1;  /* m per axis: of its positions */

void stuck_imu_reset(stuck_imu_t *imu)
{
    *imu = (stuck_imu_t){.reading = {NAN, NAN, NAN, NAN, NAN, NAN}};
}

void stuck_compass_reset(stuck_compass_t *compass)
{
    *compass = (stuck_compass_t){.reading = NAN};
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        stuck_course_t *course = &compass->course[i];
        course->track.t_us = course->now_us = course->then_us = course->against_us = SOURCE_NEVER;
    }
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

int stuck_compass_repeats(const stuck_compass_t *compass, double heading_deg, int talks_on)
{
    return talks_on && heading_deg == compass->reading;
}

int stuck_compass_take(stuck_compass_t *compass, double heading_deg, int talks_on)
{
    const int repeats = stuck_compass_repeats(compass, heading_deg, talks_on);
    if (heading_deg != compass->reading) {
        compass->reading = heading_deg;
        compass->turned = 0.0;
        compass->stuck = 0;
    }
    compass->stuck |= fabs(compass->turned) > turned_most;
    for (int i = 0; i < SAMPLE_MAX_GPS && !repeats; i++) {
        compass->course[i].then_us = compass->course[i].against_us = SOURCE_NEVER;
    }
    return compass->stuck;
}

void stuck_compass_turn(stuck_compass_t *compass, double angle, double dt)
{
    compass->turned += angle - compass->turned * dt / turned_memory_s;
}

/* The velocity and its standard deviation (m/s per axis); 0 when there is none. */
static int velocity_of(stuck_course_t *course, int64_t t_us, const gps_reading_t *gps, ground_velocity_t *velocity,
                       double *sigma)
{
    const double hdop = isnan(gps->hdop) ? GROUND_VELOCITY_UNKNOWN_HDOP : gps->hdop;
    double span;
    if (ground_velocity_own(gps, velocity)) {
        *sigma = velocity_sigma * hdop;
    } else if (ground_velocity_of_track(&course->track, gps, t_us, velocity, &span)) {
        *sigma = position_sigma * sqrt(2.0) / span * hdop;
    } else {
        return 0;
    }
    return hypot(velocity->north, velocity->east) <= velocity_most;
}

static void approach(ground_velocity_t *mean, const ground_velocity_t *velocity, double share)
{
    mean->north += share * (velocity->north - mean->north);
    mean->east += share * (velocity->east - mean->east);
}

/* Along and across the axis of a heading, without their signs: she may as well go astern. */
static void on_axis(double heading, double north, double east, double *along, double *across)
{
    *along = fabs(cos(heading) * north + sin(heading) * east);
    *across = fabs(cos(heading) * east - sin(heading) * north);
}

/* Whether the way has changed as no change of speed along the heading explains, nor any current. */
static int denies(const stuck_course_t *course, double heading, double sigma)
{
    double along, across;
    on_axis(heading, course->then.north, course->then.east, &along, &across);
    const double off_axis = fmin(off_axis_seen + atan2(across, along), off_axis_most);
    const double leeway = leeway_change * hypot(along, across);
    on_axis(heading, course->now.north - course->then.north, course->now.east - course->then.east, &along, &across);
    const double allowed = sqrt(current_change * current_change + leeway * leeway + sigmas * sigmas * sigma * sigma);
    return across * cos(off_axis) - along * sin(off_axis) > allowed;
}

void stuck_compass_move(stuck_compass_t *compass, int64_t t_us, int i, const gps_reading_t *gps, double heading)
{
    stuck_course_t *course = &compass->course[i];
    ground_velocity_t velocity;
    double sigma;
    if (!velocity_of(course, t_us, gps, &velocity, &sigma)) {
        return;
    }
    const double dt = source_seconds_since(course->now_us, t_us);
    const int goes_on = dt <= velocity_gap_s;
    approach(&course->now, &velocity, goes_on ? dt / (velocity_memory_s + dt) : 1.0);
    course->now_us = t_us;
    course->against_us = goes_on ? course->against_us : SOURCE_NEVER;

    const double speed = hypot(course->now.north, course->now.east);
    if (speed < no_way) {
        course->then_us = SOURCE_NEVER;
    } else if (course->then_us == SOURCE_NEVER && speed >= under_way) {
        course->then_us = t_us;
    }
    if (course->then_us == SOURCE_NEVER || t_us - course->then_us < settling_us) {
        course->then = course->now;
        course->against_us = SOURCE_NEVER;
        return;
    }
    approach(&course->then, &course->now, fmin(dt / then_memory_s, 1.0));
    if (!denies(course, heading, sigma)) {
        course->against_us = SOURCE_NEVER;
    } else if (course->against_us == SOURCE_NEVER) {
        course->against_us = t_us;
    }
}

int stuck_compass_is_denied(const stuck_compass_t *compass, int64_t t_us, int i)
{
    const stuck_course_t *course = &compass->course[i];
    return course->against_us != SOURCE_NEVER && course->now_us - course->against_us >= denied_us &&
           source_seconds_since(course->now_us, t_us) <= velocity_gap_s;
}
