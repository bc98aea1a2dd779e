#include "lock_up.h"

#include <string.h>

#include "angle.h"
#include "ekf.h"
#include "tinyekf.h"

static const double dt = 0.1;
static const double F[9] = {1, 0.1, 0, 0, 1, 0, 0, 0, 1};
static const double H[9] = {1, 0, 0, 1, 0, 0, 0, 1, 1};
static const double Q[9] = {1e-8, 0, 0, 0, 1e-6, 0, 0, 0, 1e-10};

/* Every filter gets the same inputs but for its own prediction; the measured headings are put near the predicted one, so
 * that a filter without wrapping is not blamed for that. */
static void make_step(tinyekf_step_t *step, const double x[3], int i, const lock_up_case_t *c)
{
    const double heading = i / 50 % 2 ? c->r_high : c->r_low;
    const double R[9] = {heading, 0, 0, 0, heading, 0, 0, 0, 1e-4};
    memcpy(step->F, F, sizeof F);
    memcpy(step->H, H, sizeof H);
    memcpy(step->Q, Q, sizeof Q);
    memcpy(step->R, R, sizeof R);
    step->fx[0] = x[0] + dt * x[1];
    step->fx[1] = x[1];
    step->fx[2] = x[2];
    step->z[0] = step->z[1] = step->fx[0] + angle_wrap(0.02 * i * dt - step->fx[0]);
    step->z[2] = 0.021;
}

int lock_up_ours(const lock_up_case_t *c)
{
    const ekf_real x0[3] = {0, 0, 0};
    const ekf_real P0[3][3] = {{c->p0, 0, 0}, {0, c->p0, 0}, {0, 0, c->p0}};
    ekf_t ekf;
    ekf_init(&ekf, x0, P0, 0);
    for (int i = 0; i < LOCK_UP_STEPS; i++) {
        tinyekf_step_t step;
        ekf_real matrices[4][3][3];
        make_step(&step, ekf.x, i, c);
        memcpy(matrices[0], step.F, sizeof matrices[0]);
        memcpy(matrices[1], step.Q, sizeof matrices[1]);
        memcpy(matrices[2], step.H, sizeof matrices[2]);
        memcpy(matrices[3], step.R, sizeof matrices[3]);
        const ekf_real(*m)[3][3] = (const ekf_real(*)[3][3])matrices;
        if (ekf_step(&ekf, step.z, step.fx, m[0], m[1], m[2], m[3]) != EKF_ACCEPTED) {
            return i;
        }
    }
    return LOCK_UP_STEPS;
}

int lock_up_tinyekf_generic(const lock_up_case_t *c)
{
    tinyekf_generic_t ekf = {.n = 3, .m = 3, .P = {c->p0, 0, 0, 0, c->p0, 0, 0, 0, c->p0}};
    for (int i = 0; i < LOCK_UP_STEPS; i++) {
        tinyekf_step_t step;
        make_step(&step, ekf.x, i, c);
        if (tinyekf_generic_step(&ekf, &step)) {
            return i;
        }
    }
    return LOCK_UP_STEPS;
}

int lock_up_tinyekf_static(const lock_up_case_t *c)
{
    tinyekf_static_t ekf = {.P = {c->p0, 0, 0, 0, c->p0, 0, 0, 0, c->p0}};
    for (int i = 0; i < LOCK_UP_STEPS; i++) {
        tinyekf_step_t step;
        make_step(&step, ekf.x, i, c);
        if (tinyekf_static_step(&ekf, &step)) {
            return i;
        }
    }
    return LOCK_UP_STEPS;
}
