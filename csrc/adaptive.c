#include "adaptive.h"

#include <math.h>
#include <stddef.h>

#include "adaptive_start.h"
#include "angle.h"
#include "velocity_vote.h"

#define TICK_US 200000

static const double tick_s = TICK_US * 1e-6;
static const double slip_lag_s = 0.8;
static const double settling_s = 0.5; /* in which a correction shows: a helmsman wants no steps */
static const double wave_memory_s = 4.0;
static const double held_within = 4.0 * ANGLE_DEGREE;
static const double speed_held_within = 0.3;        /* m/s */
static const double turn_from = 1.2 * ANGLE_DEGREE; /* rad/s: waves yaw no faster once smoothed; */
static const double turn_full = 2.4 * ANGLE_DEGREE; /* this is a turn */
static const double under_way = 1.0;                /* m/s over ground: not at rest */
static const double rest_memory_s = 2.0;
static const double rest_below = 0.22;     /* m/s over ground, meanwhile: at rest; */
static const double rest_above = 0.35;     /* no more */
static const double rest_unguided_s = 3.0; /* without a compass: with one, a swing at anchor is no bias */
static const int64_t bearing_hold_us = 3000000;
static const int64_t bearing_relearned_us = 120000000;      /* a compass refused so long has a new deviation */
static const int64_t bearing_relearned_blind_us = 10000000; /* without a gyro to hold against it */
static const int64_t contradiction_us = 6000000;            /* all refused so long: the filter is wrong, not they */
static const double most_odds = 7.0;                        /* of the logarithm */

void adaptive_reset(adaptive_t *adaptive, const adaptive_settings_t *settings)
{
    *adaptive = (adaptive_t){
        .settings = *settings,
        .tick_us = SOURCE_NEVER,
        .silent_since_us = SOURCE_NEVER,
        .bearing_taken_us = SOURCE_NEVER,
        .bearing_hold_us = SOURCE_NEVER,
        .bearing_refused_us = SOURCE_NEVER,
        .contradicted_us = SOURCE_NEVER,
        .velocity_us = SOURCE_NEVER,
        .kept.t_us = SOURCE_NEVER,
        .log_odds = adaptive_odds_of_current(settings),
    };
    yaw_history_reset(&adaptive->yaw);
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        adaptive->receiver[i].suspect_until_us = SOURCE_NEVER;
        adaptive->track[i].t_us = SOURCE_NEVER;
    }
}

/* The tick's compass readings as one; 0 when there is none to take. */
static int bearing_of(adaptive_t *adaptive, int64_t t_us, adaptive_bearing_t *mean)
{
    const adaptive_bearing_t *sum = &adaptive->bearing;
    if (sum->n == 0 || t_us < adaptive->bearing_hold_us) {
        return 0;
    }
    mean->n = sum->n;
    mean->offset = adaptive->bearing_reference + sum->offset / sum->n;
    const double shown = mean->offset + adaptive->tick_yaw;
    if (adaptive->turning > 0.0 || fabs(angle_wrap(shown - adaptive->shown)) > held_within) {
        adaptive->shown = shown;
    }
    const double s = sin(adaptive->shown);
    const double c = cos(adaptive->shown);
    mean->basis[0] = 1.0;
    mean->basis[1] = s;
    mean->basis[2] = c;
    mean->basis[3] = 2.0 * s * c;
    mean->basis[4] = c * c - s * s;
    mean->age = source_seconds_since(adaptive->tick_us, t_us) - sum->age / sum->n;
    mean->rate = sum->rate / sum->n;
    return 1;
}

/* The bearing that nobody believed: refused while it lasts and a little longer, and relearned when it lasts too long. */
static void doubt_bearing(adaptive_t *adaptive, int64_t t_us, int accepted, const adaptive_bearing_t *bearing)
{
    if (accepted) {
        adaptive->bearing_refused_us = SOURCE_NEVER;
        return;
    }
    if (adaptive->bearing_refused_us == SOURCE_NEVER) {
        adaptive->bearing_refused_us = t_us;
    }
    const int64_t lasted_us = t_us - adaptive->bearing_refused_us;
    if (lasted_us < (adaptive->gyro_live ? bearing_relearned_us : bearing_relearned_blind_us)) {
        if (adaptive->gyro_live && lasted_us > bearing_hold_us) {
            adaptive->bearing_hold_us = t_us + bearing_hold_us;
        }
        return;
    }
    for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
        adaptive_ekf_t *ekf = &adaptive->filter[k];
        const double off = angle_wrap(bearing->offset - (double)ekf->x[ADAPTIVE_OFFSET]);
        ekf->P[ADAPTIVE_DEVIATION][ADAPTIVE_DEVIATION] += (ekf_real)(off * off);
    }
    adaptive->bearing_refused_us = SOURCE_NEVER;
}

static void count(adaptive_t *adaptive, const adaptive_verdict_t verdict[ADAPTIVE_HYPOTHESES])
{
    const adaptive_verdict_t *likelier = &verdict[adaptive->log_odds > 0.0];
    if (likelier->accepted) {
        adaptive->nis += likelier->nis;
        adaptive->headings++;
    }
}

static void measure(adaptive_t *adaptive, int64_t t_us, const adaptive_bearing_t *bearing,
                    const adaptive_velocity_t *velocity)
{
    const adaptive_noise_t *noise = &adaptive->settings.noise;
    const int live = adaptive->gyro_live;
    int bearing_accepted = 0;
    int velocity_accepted = 0;
    double log_likelihood[ADAPTIVE_HYPOTHESES] = {0};
    adaptive_verdict_t verdict[ADAPTIVE_HYPOTHESES];
    if (bearing) {
        for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
            verdict[k] = adaptive_model_take_bearing(&adaptive->filter[k], noise, bearing, tick_s, live);
            bearing_accepted |= verdict[k].accepted;
        }
        for (int k = 0; bearing_accepted && k < ADAPTIVE_HYPOTHESES; k++) {
            log_likelihood[k] += verdict[k].log_likelihood;
        }
        count(adaptive, verdict);
        doubt_bearing(adaptive, t_us, bearing_accepted, bearing);
    }
    if (velocity) {
        for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
            adaptive_velocity_t mine = *velocity;
            mine.course = adaptive->course[k];
            mine.speed = adaptive->speed[k];
            verdict[k] = adaptive_model_take_velocity(&adaptive->filter[k], noise, &mine, tick_s);
            velocity_accepted |= verdict[k].accepted;
        }
        count(adaptive, verdict);
        for (int k = 0; velocity_accepted && k < ADAPTIVE_HYPOTHESES; k++) {
            log_likelihood[k] += verdict[k].log_likelihood;
        }
    }
    if (bearing_accepted) {
        adaptive->bearing_taken_us = t_us;
    }
    if (adaptive->at_rest && live && source_seconds_since(adaptive->bearing_taken_us, t_us) > rest_unguided_s) {
        for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
            adaptive_model_take_rest(&adaptive->filter[k], adaptive->gyro_rate);
        }
    }
    if (adaptive->turning > 0.0) {
        adaptive->evidence_until_us = t_us + ADAPTIVE_EVIDENCE_US;
    }
    if (t_us < adaptive->evidence_until_us) {
        adaptive->log_odds += log_likelihood[ADAPTIVE_CURRENTED] - log_likelihood[ADAPTIVE_CALM];
    }
    adaptive->log_odds = fmin(fmax(adaptive->log_odds, -most_odds), most_odds);

    if (velocity_accepted || bearing_accepted || !velocity) {
        adaptive->contradicted_us = velocity ? SOURCE_NEVER : adaptive->contradicted_us;
    } else if (adaptive->contradicted_us == SOURCE_NEVER) {
        adaptive->contradicted_us = t_us;
    } else if (t_us - adaptive->contradicted_us > contradiction_us) {
        adaptive->contradicted_us = SOURCE_NEVER;
        adaptive->running = 0;
    }
}

/* Whether she lies still: by her velocity over some seconds, for a poor receiver's noise alone looks like way. */
static void rest(adaptive_t *adaptive, const adaptive_velocity_t *velocity, double dt)
{
    if (!velocity) {
        adaptive->at_rest = 0;
        return;
    }
    const double share = dt / (rest_memory_s + dt);
    adaptive->mean_north += share * (velocity->north - adaptive->mean_north);
    adaptive->mean_east += share * (velocity->east - adaptive->mean_east);
    const double now = hypot(velocity->north, velocity->east);
    const double mean = hypot(adaptive->mean_north, adaptive->mean_east);
    adaptive->at_rest = now < under_way && mean < (adaptive->at_rest ? rest_above : rest_below);
}

/* Heading (rad) and its standard deviation of both filters together, dt seconds after the state's time: the gyro's yaw
 * is `yaw`, of which it turned by `turned` since, if it was a turn and no wave. */
static void mix(const adaptive_t *adaptive, double yaw, double turned, double dt, double *heading, double *sigma)
{
    const double chance = 1.0 / (1.0 + exp(-adaptive->log_odds));
    const double weight[ADAPTIVE_HYPOTHESES] = {1.0 - chance, chance};
    double psi[ADAPTIVE_HYPOTHESES];
    double variance = adaptive->settings.unmodelled * adaptive->settings.unmodelled;
    for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
        const ekf_real *x = adaptive->filter[k].x;
        const ekf_real(*P)[ADAPTIVE_STATES] = (const ekf_real(*)[ADAPTIVE_STATES])adaptive->filter[k].P;
        psi[k] = yaw + (double)x[ADAPTIVE_OFFSET] - dt * (double)x[ADAPTIVE_BIAS] - turned * (double)x[ADAPTIVE_GAIN];
        variance += weight[k] * (double)(P[ADAPTIVE_OFFSET][ADAPTIVE_OFFSET] +
                                         (ekf_real)(dt * dt) * P[ADAPTIVE_BIAS][ADAPTIVE_BIAS] -
                                         2 * (ekf_real)dt * P[ADAPTIVE_OFFSET][ADAPTIVE_BIAS]);
    }
    const double apart = angle_wrap(psi[ADAPTIVE_CURRENTED] - psi[ADAPTIVE_CALM]);
    variance += chance * (1.0 - chance) * apart * apart;
    *heading = angle_wrap(psi[ADAPTIVE_CALM] + chance * apart);
    *sigma = sqrt(fmax(variance, 0.0));
}

/* Tells a turn from what waves do. */
static void sense_turn(adaptive_t *adaptive, int64_t t_us, double turned, double dt)
{
    double sigma;
    const double before = adaptive->heading;
    mix(adaptive, yaw_history_at(&adaptive->yaw, t_us, NULL), 0.0, 0.0, &adaptive->heading, &sigma);
    const double bias = (double)adaptive->filter[adaptive->log_odds > 0.0].x[ADAPTIVE_BIAS];
    const double rate = (adaptive->gyro_live ? turned / dt : 0.0) - bias;
    adaptive->gyro_rate = turned / dt;
    const double blur = adaptive->gyro_live ? 1.0 : 2.0; /* without a gyro the rate is mostly noise */
    adaptive->smooth_rate += (rate - adaptive->smooth_rate) * dt / (blur * slip_lag_s + dt);
    adaptive->turning = (fabs(adaptive->smooth_rate) / blur - turn_from) / (turn_full - turn_from);
    adaptive->turning = fmin(fmax(adaptive->turning, 0.0), 1.0);
    adaptive->wave_yaw += angle_wrap(adaptive->heading - before);
    adaptive->wave_yaw *= 1.0 - fmax(dt / (wave_memory_s + dt), adaptive->turning);
    for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
        const double heading = adaptive->tick_yaw + turned + (double)adaptive->filter[k].x[ADAPTIVE_OFFSET];
        if (adaptive->turning > 0.0 || fabs(angle_wrap(heading - adaptive->course[k])) > held_within) {
            adaptive->course[k] = angle_wrap(heading - adaptive->wave_yaw);
        }
        const double speed = (double)adaptive->filter[k].x[ADAPTIVE_SPEED];
        if (adaptive->turning > 0.0 || fabs(speed - adaptive->speed[k]) > speed_held_within) {
            adaptive->speed[k] = speed;
        }
    }
}

static void tick(adaptive_t *adaptive, int64_t t_us)
{
    const double dt = source_seconds_since(adaptive->tick_us, t_us);
    const double yaw = yaw_history_at(&adaptive->yaw, t_us, NULL);
    adaptive_bearing_t bearing;
    adaptive_velocity_t velocity;
    const int has_bearing = bearing_of(adaptive, t_us, &bearing);
    const int has_velocity = velocity_vote(adaptive->receiver, SAMPLE_MAX_GPS, t_us, dt, &velocity);
    const double turned = yaw - adaptive->tick_yaw;

    rest(adaptive, has_velocity ? &velocity : NULL, dt);
    const adaptive_bearing_t *seen = has_bearing ? &bearing : NULL;
    const adaptive_velocity_t *moved = has_velocity && !adaptive->at_rest ? &velocity : NULL;
    double foretold;
    double sigma;
    const int was_running = adaptive_heading(adaptive, t_us, &foretold, &sigma) && !adaptive->misled;
    if (adaptive->misled) {
        adaptive_go_back(adaptive, t_us);
    }
    if (adaptive->running || adaptive_start(adaptive, t_us, seen, moved)) {
        adaptive_hear_gyro(adaptive, t_us);
        for (int k = 0; k < ADAPTIVE_HYPOTHESES; k++) {
            adaptive_model_predict(&adaptive->filter[k], &adaptive->settings.noise, k, dt, turned * adaptive->turning,
                                   adaptive->gyro_live);
        }
        sense_turn(adaptive, t_us, turned, dt);
        bearing.turning = adaptive->turning;
        velocity.turning = adaptive->turning;
        velocity.rate = adaptive->smooth_rate;
        measure(adaptive, t_us, seen, moved);
    }
    adaptive->tick_us = t_us;
    adaptive->tick_yaw = yaw;
    if (was_running && adaptive->running) { /* what was measured shows little by little */
        double found;
        adaptive->unsettled = 0.0;
        adaptive_heading(adaptive, t_us, &found, &sigma);
        adaptive->unsettled = angle_wrap(foretold - found);
    }
    adaptive->bearing = (adaptive_bearing_t){0};
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        adaptive_receiver_t *sum = &adaptive->receiver[i];
        *sum = (adaptive_receiver_t){.suspect_until_us = sum->suspect_until_us};
    }
}

void adaptive_advance(adaptive_t *adaptive, int64_t t_us)
{
    if (adaptive->tick_us == SOURCE_NEVER) {
        adaptive->tick_us = t_us;
        adaptive->tick_yaw = yaw_history_at(&adaptive->yaw, t_us, NULL);
    }
    const int64_t due_us = adaptive->tick_us + TICK_US;
    if (t_us >= due_us) {
        tick(adaptive, due_us);
        if (t_us - due_us >= TICK_US) { /* a silence: one step over the whole of it */
            tick(adaptive, t_us);
        }
    }
}

int adaptive_heading(const adaptive_t *adaptive, int64_t t_us, double *heading, double *sigma)
{
    if (!adaptive->running) {
        return 0;
    }
    const double yaw = yaw_history_at(&adaptive->yaw, t_us, NULL);
    const double dt = source_seconds_since(adaptive->tick_us, t_us);
    const double unsettled = adaptive->unsettled * exp(-dt / settling_s);
    mix(adaptive, yaw, (yaw - adaptive->tick_yaw) * adaptive->turning, dt, heading, sigma);
    *heading = angle_wrap(*heading + unsettled);
    *sigma = hypot(*sigma, unsettled);
    return 1;
}
