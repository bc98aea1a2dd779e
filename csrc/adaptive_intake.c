/* What the sensors say between two ticks of the adaptive method: each reading is put beside the gyro's yaw at the moment
 * when it was measured, and summed. */
#include <math.h>

#include "adaptive.h"
#include "angle.h"
#include "local_frame.h"

static const double unknown_hdop = 2.0;
static const double least_hdop = 0.6;
static const double still = 0.35; /* m/s: a receiver with a blank course and less speed says that she lies still */
static const double shortest_baseline_s = 2.0;    /* over less, a track shows the positions' noise */
static const double longest_baseline_s = 3.0;     /* over more, the boat's turns; and the yaw history ends */
static const int64_t velocity_lasts_us = 2000000; /* so long after a receiver's own velocity no track is looked at */

static int64_t moment_of(const adaptive_t *adaptive, int source, int64_t t_us)
{
    return t_us - (int64_t)(adaptive->settings.latency_s[source] * 1e6);
}

void adaptive_turn(adaptive_t *adaptive, int64_t t_us, double angle, double rate)
{
    yaw_history_turn(&adaptive->yaw, moment_of(adaptive, SAMPLE_IMU, t_us), angle, rate);
}

void adaptive_bear(adaptive_t *adaptive, int64_t t_us, double heading)
{
    adaptive_bearing_t *sum = &adaptive->bearing;
    const int64_t then_us = moment_of(adaptive, SAMPLE_COMPASS, t_us);
    double rate;
    const double offset = heading - yaw_history_at(&adaptive->yaw, then_us, &rate);
    if (sum->n == 0) {
        adaptive->bearing_reference = offset;
    }
    sum->offset += angle_wrap(offset - adaptive->bearing_reference);
    sum->age += source_seconds_since(adaptive->tick_us, then_us);
    sum->rate += rate;
    sum->n++;
}

/* A velocity over ground, m/s, and how it was come by. */
typedef struct {
    double north;
    double east;
    double sigma;    /* per axis, at HDOP 1 */
    int64_t then_us; /* the moment measured */
} velocity_t;

/* What the receiver itself says; 0 when it does not say enough. */
static int own_velocity(const adaptive_t *adaptive, const gps_reading_t *reading, velocity_t *velocity)
{
    const double speed = reading->speed_mps;
    const double course = reading->course_deg * ANGLE_DEGREE;
    if (!(speed >= 0.0 && speed < INFINITY) || (!isfinite(course) && speed > still)) {
        return 0;
    }
    velocity->north = isfinite(course) ? speed * cos(course) : 0.0;
    velocity->east = isfinite(course) ? speed * sin(course) : 0.0;
    velocity->sigma = adaptive->settings.noise.velocity;
    return 1;
}

/* Its way over a baseline long enough to mean something; 0 until there is one. */
static int velocity_of_track(const adaptive_t *adaptive, adaptive_track_t *track, const gps_reading_t *reading,
                             velocity_t *velocity)
{
    const double span = source_seconds_since(track->t_us, velocity->then_us);
    if (span >= 0.0 && span < shortest_baseline_s) {
        return 0;
    }
    const adaptive_track_t before = *track;
    *track = (adaptive_track_t){reading->lat_deg, reading->lon_deg, velocity->then_us};
    if (!(span >= 0.0 && span <= longest_baseline_s)) {
        return 0;
    }
    local_frame_t frame;
    local_frame_set(&frame, before.lat_deg * ANGLE_DEGREE, before.lon_deg * ANGLE_DEGREE);
    local_frame_to_metres(&frame, reading->lat_deg * ANGLE_DEGREE, reading->lon_deg * ANGLE_DEGREE, &velocity->north,
                          &velocity->east);
    velocity->north /= span;
    velocity->east /= span;
    velocity->sigma = adaptive->settings.noise.position * sqrt(2.0) / span;
    velocity->then_us -= (int64_t)(0.5e6 * span);
    return 1;
}

/* From the velocity of an antenna to that of the point about which the boat is thought to pivot: what her turn does to
 * the one and not to the other is taken off. */
static void refer(const adaptive_t *adaptive, const double arm[2], double yaw, double rate, velocity_t *velocity)
{
    if (!adaptive->running) {
        return;
    }
    const double heading = adaptive->heading + (yaw - adaptive->tick_yaw);
    const double turn = rate - (double)adaptive->filter[adaptive->log_odds > 0.0].x[ADAPTIVE_BIAS];
    const double ahead = -turn * arm[1];
    const double aside = turn * (arm[0] - adaptive->settings.noise.pivot);
    velocity->north -= ahead * cos(heading) - aside * sin(heading);
    velocity->east -= ahead * sin(heading) + aside * cos(heading);
}

void adaptive_move(adaptive_t *adaptive, int64_t t_us, int i, const gps_reading_t *reading, double weight)
{
    double hdop = reading->hdop;
    if (isnan(hdop)) { /* the receiver does not say how good it is */
        hdop = unknown_hdop;
        weight = 1.0;
    }
    if (!(weight > 0.0)) {
        return;
    }
    velocity_t velocity = {.then_us = moment_of(adaptive, i, t_us)};
    if (own_velocity(adaptive, reading, &velocity)) {
        adaptive->velocity_us = t_us;
    } else if ((adaptive->velocity_us != SOURCE_NEVER && t_us - adaptive->velocity_us < velocity_lasts_us) ||
               !velocity_of_track(adaptive, &adaptive->track[i], reading, &velocity)) {
        return;
    }
    adaptive_receiver_t *sum = &adaptive->receiver[i];
    const double sigma = velocity.sigma * fmax(hdop, least_hdop);
    double rate;
    const double yaw = yaw_history_at(&adaptive->yaw, velocity.then_us, &rate);
    refer(adaptive, adaptive->settings.arm[i], yaw, rate, &velocity);
    sum->yaw += yaw;
    sum->north += velocity.north;
    sum->east += velocity.east;
    sum->age += source_seconds_since(adaptive->tick_us, velocity.then_us);
    sum->variance += sigma * sigma * 3.0 / weight;
    sum->n++;
}
