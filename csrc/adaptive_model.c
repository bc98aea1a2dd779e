#include "adaptive_model.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "angle.h"

static const double unknown_offset = 60.0 * ANGLE_DEGREE; /* before anything has measured it */
static const double unknown_speed = 1.0;                  /* m/s */
static const double gate = 16.0;                          /* 4 sigma */
static const double surprise = 9.0;                       /* 3 sigma: the helmsman has changed the speed */
static const double rest_rate = 1.0 * ANGLE_DEGREE;       /* rad/s: how a boat at rest swings, a tick's worth */
static const double cross_quick = 0.15;                   /* m/s: of one tick's velocity, beside its mean error */

static double square(double x)
{
    return x * x;
}

void adaptive_model_start(adaptive_ekf_t *ekf, const adaptive_noise_t *noise, int with_current, double offset,
                          double speed)
{
    ekf_real x[ADAPTIVE_STATES] = {0};
    ekf_real P[ADAPTIVE_STATES][ADAPTIVE_STATES] = {{0}};
    double sigma[ADAPTIVE_STATES];
    x[ADAPTIVE_OFFSET] = (ekf_real)offset;
    x[ADAPTIVE_LAG] = (ekf_real)noise->lag_mean;
    x[ADAPTIVE_SPEED] = (ekf_real)speed;
    sigma[ADAPTIVE_OFFSET] = unknown_offset;
    sigma[ADAPTIVE_BIAS] = noise->bias;
    sigma[ADAPTIVE_GAIN] = noise->gain;
    for (int i = 0; i < 5; i++) {
        sigma[ADAPTIVE_DEVIATION + i] = noise->deviation[i];
    }
    sigma[ADAPTIVE_LAG] = noise->lag;
    sigma[ADAPTIVE_SPEED] = unknown_speed;
    sigma[ADAPTIVE_SLIP] = noise->slip;
    sigma[ADAPTIVE_CURRENT] = sigma[ADAPTIVE_CURRENT + 1] = noise->current[with_current];
    for (int i = 0; i < ADAPTIVE_STATES; i++) {
        P[i][i] = (ekf_real)square(sigma[i]);
    }
    adaptive_ekf_init(ekf, x, (const ekf_real(*)[ADAPTIVE_STATES])P, 1u << ADAPTIVE_OFFSET);
}

void adaptive_model_predict(adaptive_ekf_t *ekf, const adaptive_noise_t *noise, int with_current, double dt,
                            double turned, int gyro_live)
{
    ekf_real fx[ADAPTIVE_STATES];
    ekf_real F[ADAPTIVE_STATES][ADAPTIVE_STATES] = {{0}};
    ekf_real Q[ADAPTIVE_STATES][ADAPTIVE_STATES] = {{0}};
    double walk[ADAPTIVE_STATES] = {0}; /* per root second */

    memcpy(fx, ekf->x, sizeof fx);
    fx[ADAPTIVE_OFFSET] -= (ekf_real)(dt * (double)fx[ADAPTIVE_BIAS] + turned * (double)fx[ADAPTIVE_GAIN]);
    for (int i = 0; i < ADAPTIVE_STATES; i++) {
        F[i][i] = 1;
    }
    F[ADAPTIVE_OFFSET][ADAPTIVE_BIAS] = (ekf_real)-dt;
    F[ADAPTIVE_OFFSET][ADAPTIVE_GAIN] = (ekf_real)-turned;

    walk[ADAPTIVE_OFFSET] = noise->gyro;
    walk[ADAPTIVE_BIAS] = gyro_live ? noise->bias_walk : noise->unseen_turn;
    for (int i = 0; i < 5; i++) {
        walk[ADAPTIVE_DEVIATION + i] = noise->deviation_walk;
    }
    walk[ADAPTIVE_SPEED] = noise->speed_walk;
    walk[ADAPTIVE_CURRENT] = walk[ADAPTIVE_CURRENT + 1] = noise->current_walk[with_current];
    for (int i = 0; i < ADAPTIVE_STATES; i++) {
        Q[i][i] = (ekf_real)(square(walk[i]) * dt);
    }
    if (!gyro_live) { /* the rate's walk reaches the heading within the interval */
        Q[ADAPTIVE_OFFSET][ADAPTIVE_OFFSET] += Q[ADAPTIVE_BIAS][ADAPTIVE_BIAS] * (ekf_real)(dt * dt / 3.0);
        Q[ADAPTIVE_OFFSET][ADAPTIVE_BIAS] = Q[ADAPTIVE_BIAS][ADAPTIVE_OFFSET] =
            -Q[ADAPTIVE_BIAS][ADAPTIVE_BIAS] * (ekf_real)(dt / 2.0);
    }
    adaptive_ekf_predict(ekf, fx, (const ekf_real(*)[ADAPTIVE_STATES])F, (const ekf_real(*)[ADAPTIVE_STATES])Q);
}

void adaptive_model_renew(adaptive_ekf_t *ekf, int state, double mean, double variance)
{
    for (int i = 0; i < ADAPTIVE_STATES; i++) {
        ekf->P[state][i] = ekf->P[i][state] = 0;
    }
    ekf->x[state] = (ekf_real)mean;
    ekf->P[state][state] = (ekf_real)variance;
}

void adaptive_model_start_again(adaptive_ekf_t *ekf, double offset, double speed)
{
    adaptive_model_renew(ekf, ADAPTIVE_OFFSET, offset, square(unknown_offset));
    adaptive_model_renew(ekf, ADAPTIVE_SPEED, speed, square(unknown_speed));
}

/* H P H' */
static double variance_of(const adaptive_ekf_t *ekf, const ekf_real h[ADAPTIVE_STATES])
{
    double sum = 0.0;
    for (int i = 0; i < ADAPTIVE_STATES; i++) {
        if (h[i] != 0) {
            for (int j = 0; j < ADAPTIVE_STATES; j++) {
                sum += (double)(h[i] * ekf->P[i][j] * h[j]);
            }
        }
    }
    return sum;
}

/* Takes one row whose error has a memory: `quick` is the variance of what is new in it, by which it is judged, `slow` the
 * one with which it may be taken so often. */
static adaptive_verdict_t take(adaptive_ekf_t *ekf, const ekf_real h[ADAPTIVE_STATES], double innovation, double quick,
                               double slow)
{
    adaptive_verdict_t verdict = {0};
    const double known = variance_of(ekf, h);
    const double S = known + slow;
    if (square(innovation) > gate * (known + quick)) {
        verdict.log_likelihood = -0.5 * (gate * (known + quick) / S + log(S));
        return verdict;
    }
    adaptive_ekf_measurement_t m = {.rows = 1};
    memcpy(m.H[0], h, sizeof m.H[0]);
    m.z[0] = (ekf_real)innovation;
    m.R[0][0] = (ekf_real)slow;
    verdict.accepted = adaptive_ekf_update(ekf, &m, NULL) == EKF_ACCEPTED;
    verdict.nis = square(innovation) / S;
    verdict.log_likelihood = -0.5 * (verdict.nis + log(S));
    return verdict;
}

adaptive_verdict_t adaptive_model_take_bearing(adaptive_ekf_t *ekf, const adaptive_noise_t *noise,
                                               const adaptive_bearing_t *bearing, double tick_s, int gyro_live)
{
    const ekf_real *x = ekf->x;
    const double lag = (double)x[ADAPTIVE_LAG];
    const double rate = bearing->rate - (double)x[ADAPTIVE_BIAS];
    ekf_real h[ADAPTIVE_STATES] = {0};
    double deviation = 0.0;
    for (int i = 0; i < 5; i++) {
        h[ADAPTIVE_DEVIATION + i] = (ekf_real)-bearing->basis[i];
        deviation += bearing->basis[i] * (double)x[ADAPTIVE_DEVIATION + i];
    }
    h[ADAPTIVE_OFFSET] = 1;
    h[ADAPTIVE_BIAS] = (ekf_real)(bearing->age + lag);
    h[ADAPTIVE_LAG] =
        gyro_live ? (ekf_real)(-rate * bearing->turning) : 0; /* a rate that is only guessed shows no lag */
    const double expected =
        (double)x[ADAPTIVE_OFFSET] + bearing->age * (double)x[ADAPTIVE_BIAS] - lag * rate - deviation;
    const double quick = square(noise->compass) + square(noise->compass_quick);
    const double slow = square(noise->compass) * fmax(1.0, 2.0 * noise->compass_memory_s / tick_s);
    return take(ekf, h, angle_wrap(bearing->offset - expected), square(3.0 * noise->compass_quick) + quick,
                square(noise->compass_quick) + (gyro_live ? slow : 0.0));
}

adaptive_verdict_t adaptive_model_take_velocity(adaptive_ekf_t *ekf, const adaptive_noise_t *noise,
                                                const adaptive_velocity_t *velocity, double tick_s)
{
    const ekf_real *x = ekf->x;
    const double rate = velocity->rate * velocity->turning;
    const double waves = square(noise->waves);
    const double quick = velocity->variance + waves + square(cross_quick);
    const double slow = velocity->variance * fmax(1.0, 0.5 * (1.0 + 2.0 * noise->velocity_memory_s / tick_s)) +
                        waves * fmax(1.0, 2.0 * noise->waves_memory_s / tick_s);
    const double turning = square(noise->aside_per_turn * rate);

    /* Judged along and across the course that she steers. Waves yaw and sway her in step: would their yaw reach the
     * Jacobian, it would be taken for a turn that shows the current. */
    const double c = cos(velocity->course);
    const double s = sin(velocity->course);
    double north;
    double east;
    adaptive_verdict_t verdict = {0};
    for (int across = 0; across < 2; across++) {
        const double heading = velocity->yaw + (double)x[ADAPTIVE_OFFSET] + velocity->age * (double)x[ADAPTIVE_BIAS];
        const double speed = (double)x[ADAPTIVE_SPEED];
        const double slip = (double)x[ADAPTIVE_SLIP] * rate;
        north = velocity->north - (double)x[ADAPTIVE_CURRENT] - speed * cos(heading) + slip * sin(heading);
        east = velocity->east - (double)x[ADAPTIVE_CURRENT + 1] - speed * sin(heading) - slip * cos(heading);
        ekf_real h[ADAPTIVE_STATES] = {0};
        adaptive_verdict_t row;
        if (!across) {
            const double innovation = c * north + s * east;
            h[ADAPTIVE_SPEED] = 1;
            h[ADAPTIVE_CURRENT] = (ekf_real)c;
            h[ADAPTIVE_CURRENT + 1] = (ekf_real)s;
            if (square(innovation) > surprise * (variance_of(ekf, h) + velocity->variance + waves)) {
                ekf->P[ADAPTIVE_SPEED][ADAPTIVE_SPEED] += (ekf_real)square(innovation);
            }
            row = take(ekf, h, innovation, quick, slow);
        } else {
            h[ADAPTIVE_OFFSET] = (ekf_real)velocity->speed;
            h[ADAPTIVE_BIAS] = (ekf_real)(velocity->age * velocity->speed);
            h[ADAPTIVE_SLIP] = (ekf_real)rate;
            h[ADAPTIVE_CURRENT] = (ekf_real)-s;
            h[ADAPTIVE_CURRENT + 1] = (ekf_real)c;
            row = take(ekf, h, c * east - s * north, quick + turning, slow + turning);
        }
        verdict.accepted = row.accepted;
        verdict.nis = row.nis;
        verdict.log_likelihood += row.log_likelihood;
    }
    return verdict;
}

void adaptive_model_take_rest(adaptive_ekf_t *ekf, double rate)
{
    ekf_real h[ADAPTIVE_STATES] = {0};
    h[ADAPTIVE_BIAS] = 1;
    take(ekf, h, rate - (double)ekf->x[ADAPTIVE_BIAS], square(rest_rate), square(rest_rate));
}
