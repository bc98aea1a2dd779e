/* What the sensors say between two ticks of the adaptive method: each reading is put beside the gyro's yaw at the moment
 * when it was measured, and summed. */
#include <math.h>

#include "adaptive.h"
#include "angle.h"
#include "ground_velocity.h"

static const double least_hdop = 0.6;
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

/* From the velocity of an antenna to that of the point about which the boat is thought to pivot: what her turn does to
 * the one and not to the other is taken off. */
static void refer(const adaptive_t *adaptive, const double arm[2], double yaw, double rate, ground_velocity_t *velocity)
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
        hdop = GROUND_VELOCITY_UNKNOWN_HDOP;
        weight = 1.0;
    }
    if (!(weight > 0.0)) {
        return;
    }
    const adaptive_noise_t *noise = &adaptive->settings.noise;
    int64_t then_us = moment_of(adaptive, i, t_us);
    double sigma = noise->velocity;
    double span;
    ground_velocity_t velocity;
    if (ground_velocity_own(reading, &velocity)) {
        adaptive->velocity_us = t_us;
    } else if ((adaptive->velocity_us != SOURCE_NEVER && t_us - adaptive->velocity_us < velocity_lasts_us) ||
               !ground_velocity_of_track(&adaptive->track[i], reading, then_us, &velocity, &span)) {
        return;
    } else {
        sigma = noise->position * sqrt(2.0) / span;
        then_us -= (int64_t)(0.5e6 * span);
    }
    adaptive_receiver_t *sum = &adaptive->receiver[i];
    double rate;
    const double yaw = yaw_history_at(&adaptive->yaw, then_us, &rate);
    refer(adaptive, adaptive->settings.arm[i], yaw, rate, &velocity);
    sigma *= fmax(hdop, least_hdop);
    sum->yaw += yaw;
    sum->north += velocity.north;
    sum->east += velocity.east;
    sum->age += source_seconds_since(adaptive->tick_us, then_us);
    sum->variance += sigma * sigma * 3.0 / weight;
    sum->n++;
}
