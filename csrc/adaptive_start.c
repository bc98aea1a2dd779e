#include "adaptive_start.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

static const double starting_speed = 1.0; /* m/s: slower, a course is no first heading */

double adaptive_odds_of_current(const adaptive_settings_t *settings)
{
    return log(settings->current_chance / (1.0 - settings->current_chance));
}

static void each_renew(adaptive_t *adaptive, int state, const double mean[ADAPTIVE_HYPOTHESES],
                       const double variance[ADAPTIVE_HYPOTHESES])
{
    for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
        adaptive_model_renew(&adaptive->filter[k], state, mean[k], variance[k]);
    }
}

void adaptive_hear_gyro(adaptive_t *adaptive, int64_t t_us)
{
    const adaptive_noise_t *noise = &adaptive->settings.noise;
    const int live = yaw_history_is_live(&adaptive->yaw, t_us);
    if (live == adaptive->gyro_live) {
        return;
    }
    double mean[ADAPTIVE_HYPOTHESES];
    double variance[ADAPTIVE_HYPOTHESES];
    for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
        const adaptive_ekf_t *ekf = &adaptive->filter[k];
        if (live) {
            const double away = source_seconds_since(adaptive->silent_since_us, t_us);
            const int known = adaptive->silent_since_us != SOURCE_NEVER;
            mean[k] = known ? adaptive->bias_of[k] : 0.0;
            variance[k] = known ? adaptive->bias_variance_before[k] + away * noise->bias_walk * noise->bias_walk
                                : noise->bias * noise->bias;
        } else {
            adaptive->bias_of[k] = (double)ekf->x[ADAPTIVE_BIAS];
            adaptive->bias_variance_before[k] = (double)ekf->P[ADAPTIVE_BIAS][ADAPTIVE_BIAS];
            mean[k] = adaptive->bias_of[k] - adaptive->yaw.rate[adaptive->yaw.newest];
            variance[k] = noise->unseen_rate * noise->unseen_rate;
        }
    }
    if (!live) {
        adaptive->silent_since_us = t_us;
    }
    adaptive->gyro_live = live;
    each_renew(adaptive, ADAPTIVE_BIAS, mean, variance);
}

void adaptive_keep(adaptive_t *adaptive)
{
    if (adaptive->running && !adaptive->misled) {
        memcpy(adaptive->kept.filter, adaptive->filter, sizeof adaptive->filter);
        adaptive->kept.log_odds = adaptive->log_odds;
        adaptive->kept.t_us = adaptive->tick_us;
    }
}

void adaptive_unlearn(adaptive_t *adaptive)
{
    adaptive->misled = adaptive->running;
    adaptive->bearing = (adaptive_bearing_t){0};
}

void adaptive_go_back(adaptive_t *adaptive, int64_t t_us)
{
    const adaptive_kept_t *kept = &adaptive->kept;
    const double since = source_seconds_since(kept->t_us, t_us);
    adaptive->misled = 0;
    adaptive->running = 0;
    adaptive->learned = kept->t_us != SOURCE_NEVER;
    adaptive->log_odds = adaptive->learned ? kept->log_odds : adaptive_odds_of_current(&adaptive->settings);
    for (int k = 0; adaptive->learned && k < ADAPTIVE_HYPOTHESES; k++) {
        adaptive->filter[k] = kept->filter[k];
        adaptive_model_predict(&adaptive->filter[k], &adaptive->settings.noise, k, since, 0.0, 1);
    }
}

int adaptive_start(adaptive_t *adaptive, int64_t t_us, const adaptive_bearing_t *bearing,
                   const adaptive_velocity_t *velocity)
{
    const adaptive_noise_t *noise = &adaptive->settings.noise;
    const double speed = velocity ? hypot(velocity->north, velocity->east) : 0.0;
    const double course = velocity ? atan2(velocity->east, velocity->north) : 0.0;
    double offset;
    double ahead = 0.0;
    if (bearing) {
        offset = bearing->offset;
        ahead = velocity ? speed * cos(course - velocity->yaw - offset) : 0.0;
    } else if (speed > starting_speed) {
        offset = course - velocity->yaw;
        ahead = speed;
    } else {
        return 0;
    }
    adaptive->gyro_live = yaw_history_is_live(&adaptive->yaw, t_us);
    for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
        if (adaptive->learned) {
            adaptive_model_start_again(&adaptive->filter[k], offset, ahead);
        } else {
            adaptive_model_start(&adaptive->filter[k], noise, k, offset, ahead);
        }
        if (adaptive->learned || !adaptive->gyro_live) {
            const double sigma = adaptive->gyro_live ? noise->bias : noise->unseen_rate;
            adaptive_model_renew(&adaptive->filter[k], ADAPTIVE_BIAS, 0.0, sigma * sigma);
        }
    }
    adaptive->silent_since_us = adaptive->learned ? adaptive->silent_since_us : SOURCE_NEVER;
    adaptive->learned = 0;
    adaptive->running = 1;
    adaptive->evidence_until_us = t_us + ADAPTIVE_EVIDENCE_US;
    adaptive->heading = yaw_history_at(&adaptive->yaw, t_us, NULL) + offset;
    adaptive->wave_yaw = 0.0;
    adaptive->speed[ADAPTIVE_CALM] = adaptive->speed[ADAPTIVE_CURRENTED] = ahead;
    adaptive->course[ADAPTIVE_CALM] = adaptive->course[ADAPTIVE_CURRENTED] = adaptive->heading;
    return 1;
}
