/* The filter's promises: it never locks up, P stays symmetric and positive definite, and what it refuses changes nothing. */
#include <math.h>
#include <string.h>

#include "angle.h"
#include "ekf.h"
#include "expect.h"
#include "heading_model.h"

static int is_positive_definite(const ekf_real P[3][3])
{
    const double a = (double)P[0][0];
    const double b = (double)P[1][0] / a;
    const double c = (double)P[2][0] / a;
    const double d = (double)P[1][1] - b * (double)P[1][0];
    const double e = (double)P[2][1] - b * (double)P[2][0];
    const double f = (double)P[2][2] - c * (double)P[2][0] - e * e / d;
    const int symmetric = P[0][1] == P[1][0] && P[0][2] == P[2][0] && P[1][2] == P[2][1];
    return symmetric && a > 0.0 && d > 0.0 && f > 0.0;
}

/* 72,000 steps of a heading, rate and bias filter with two headings whose noise swings over many decades. Swinging together
 * (r2_period 50) over the widest range, it is the course that kills TinyEKF's algorithm at the third step: its covariance
 * loses positive definiteness, its Cholesky then fails for good. */
static void never_locks_up(double p0, double r_low, double r_high, int r2_period)
{
    const double dt = 0.1;
    const ekf_real F[3][3] = {{1, (ekf_real)dt, 0}, {0, 1, 0}, {0, 0, 1}};
    const ekf_real H[3][3] = {{1, 0, 0}, {1, 0, 0}, {0, 1, 1}};
    const ekf_real Q[3][3] = {{(ekf_real)1e-8, 0, 0}, {0, (ekf_real)1e-6, 0}, {0, 0, (ekf_real)1e-10}};
    const ekf_real x0[3] = {0, 0, 0};
    const ekf_real P0[3][3] = {{(ekf_real)p0, 0, 0}, {0, (ekf_real)p0, 0}, {0, 0, (ekf_real)p0}};
    ekf_t ekf;
    int failures = 0;
    int indefinite = 0;
    EXPECT(ekf_init(&ekf, x0, P0, 1u) == EKF_ACCEPTED);
    for (int step = 0; step < 72000; step++) {
        const double truth = angle_wrap(0.02 * step * dt);
        const double r1 = step / 50 % 2 ? r_high : r_low;
        const double r2 = step / r2_period % 2 ? r_high : r_low;
        const ekf_real R[3][3] = {{(ekf_real)r1, 0, 0}, {0, (ekf_real)r2, 0}, {0, 0, (ekf_real)1e-4}};
        const ekf_real fx[3] = {ekf.x[0] + (ekf_real)dt * ekf.x[1], ekf.x[1], ekf.x[2]};
        ekf_measurement_t m = {.rows = 7u, .angle_rows = 3u};
        failures += ekf_predict(&ekf, fx, F, Q) != EKF_ACCEPTED;
        m.z[0] = m.z[1] = (ekf_real)truth;
        m.z[2] = (ekf_real)0.021;
        m.hx[0] = m.hx[1] = ekf.x[0];
        m.hx[2] = ekf.x[1] + ekf.x[2];
        memcpy(m.H, H, sizeof H);
        memcpy(m.R, R, sizeof R);
        failures += ekf_update(&ekf, &m, NULL) != EKF_ACCEPTED;
        indefinite += !is_positive_definite((const ekf_real(*)[3])ekf.P);
    }
    EXPECT(failures == 0);
    EXPECT(indefinite == 0);
    EXPECT(fabs(angle_wrap((double)ekf.x[0] - 0.02 * 71999 * dt)) < 0.01);
    if (failures || indefinite) {
        printf("  P0 %g, R %g to %g, %d: %d failures, %d times not positive definite\n", p0, r_low, r_high, r2_period,
               failures, indefinite);
    }
}

static ekf_t started(void)
{
    const ekf_real x0[3] = {10, -20, (ekf_real)3.1};
    const ekf_real P0[3][3] = {{4, 1, 0}, {1, 3, (ekf_real)0.5}, {0, (ekf_real)0.5, 2}};
    ekf_t ekf;
    EXPECT(ekf_init(&ekf, x0, P0, 1u << HEADING_PSI) == EKF_ACCEPTED);
    return ekf;
}

static void refusal_changes_nothing(void)
{
    const double bad[] = {NAN, INFINITY, -INFINITY};
    const double q[3] = {0.01, 0.01, 0.003};
    const double r[3] = {0.3, 0.07, 1e-5};
    for (int k = 0; k < 3; k++) {
        ekf_t ekf = started();
        const ekf_t before = ekf;
        for (int i = 0; i < 3; i++) {
            double z[3] = {11, -19, 3.0};
            double noise[3] = {0.3, 0.07, 1e-5};
            ekf_real nis;
            z[i] = bad[k];
            EXPECT(heading_model_update(&ekf, z, 7u, r, 0.0, &nis) == EKF_REFUSED);
            EXPECT(isnan(nis));
            z[i] = 1.0;
            noise[i] = bad[k];
            EXPECT(heading_model_update(&ekf, z, 7u, noise, 0.0, NULL) == EKF_REFUSED);
        }
        EXPECT(heading_model_predict(&ekf, bad[k], 0.0, 0.0, 0.1, q) == EKF_REFUSED);
        EXPECT(heading_model_predict(&ekf, 1.0, 0.0, bad[k], 0.1, q) == EKF_REFUSED);
        EXPECT(heading_model_predict(&ekf, 1.0, 0.0, 0.0, bad[k], q) == EKF_REFUSED);
        EXPECT(memcmp(&ekf, &before, sizeof ekf) == 0);
    }
}

static void failure_keeps_the_prediction(void)
{
    ekf_t ekf = started();
    const ekf_t before = ekf;
    const double z[3] = {11, -19, 3.0};
    const double negative[3] = {0.3, -5.0, 1e-5};
    EXPECT(heading_model_update(&ekf, z, 7u, negative, 0.0, NULL) == EKF_FAILED);
    EXPECT(memcmp(&ekf, &before, sizeof ekf) == 0);

    ekf_measurement_t m = {.H = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, .rows = 7u};
    const ekf_real indefinite[3][3] = {{1, 2, 0}, {2, 1, 0}, {0, 0, 1}};
    memcpy(m.R, indefinite, sizeof indefinite);
    EXPECT(ekf_update(&ekf, &m, NULL) == EKF_FAILED);
    EXPECT(memcmp(&ekf, &before, sizeof ekf) == 0);
    EXPECT(heading_model_update(&ekf, z, 0u, negative, 0.0, NULL) == EKF_SKIPPED);
    EXPECT(memcmp(&ekf, &before, sizeof ekf) == 0);
}

static void gate_reports_what_it_refused(void)
{
    ekf_t ekf = started();
    const ekf_t before = ekf;
    const double r[3] = {0.3, 0.07, 1e-5};
    const double far[3] = {1000, -19, 3.0};
    const double near[3] = {10.1, -20.1, 3.0};
    ekf_real nis;
    EXPECT(heading_model_update(&ekf, far, 7u, r, 16.27, &nis) == EKF_GATED);
    EXPECT((double)nis > 1e4);
    EXPECT(memcmp(&ekf, &before, sizeof ekf) == 0);
    EXPECT(heading_model_update(&ekf, near, 7u, r, 16.27, &nis) == EKF_ACCEPTED);
    EXPECT((double)nis < 16.27);
}

static void heading_innovation_wraps(void)
{
    ekf_t ekf = started();
    const double z[3] = {0, 0, -3.1}; /* 0.083 rad to starboard of 3.1, across south */
    const double r[3] = {1, 1, 2.0};  /* equal to P: half way */
    EXPECT(heading_model_update(&ekf, z, 1u << HEADING_PSI, r, 0.0, NULL) == EKF_ACCEPTED);
    EXPECT_NEAR(angle_wrap((double)ekf.x[HEADING_PSI] - ANGLE_PI), 0.0, 1e-6);
}

/* Correlated noise against the textbook's joint update, worked out by hand for two rows of one state. */
static void correlated_noise_is_weighed_jointly(void)
{
    ekf_t ekf = started();
    ekf_measurement_t m = {.H = {{1, 0, 0}, {1, 0, 0}}, .rows = 3u, .z = {12, 9}, .hx = {10, 10}};
    m.R[0][0] = 2;
    m.R[1][1] = 1;
    m.R[0][1] = m.R[1][0] = (ekf_real)0.5;
    /* S = [[6, 4.5], [4.5, 5]], det 9.75, K0 = 4 [0.5, 1.5] / 9.75; z - hx = [2, -1] */
    ekf_real nis;
    EXPECT(ekf_update(&ekf, &m, &nis) == EKF_ACCEPTED);
    EXPECT_NEAR(ekf.x[0], 10.0 + 4.0 * (0.5 * 2.0 - 1.5) / 9.75, 1e-5);
    EXPECT_NEAR(ekf.P[0][0], 4.0 - 16.0 * 2.0 / 9.75, 1e-5);
    EXPECT_NEAR(nis, (5.0 * 4.0 + 2.0 * 4.5 * 2.0 + 6.0) / 9.75, 1e-5);
}

int main(void)
{
    for (int r2_period = 50; r2_period <= 70; r2_period += 20) {
        never_locks_up(1.0, 1e-2, 1.0, r2_period);
        never_locks_up(1e2, 1e-2, 1e4, r2_period);
        never_locks_up(1e3, 1e-4, 1e6, r2_period);
        never_locks_up(1e4, 1e-4, 1e8, r2_period);
        never_locks_up(1e6, 1e-6, 1e9, r2_period);
    }
    refusal_changes_nothing();
    failure_keeps_the_prediction();
    gate_reports_what_it_refused();
    heading_innovation_wraps();
    correlated_noise_is_weighed_jointly();
    return expect_verdict("ekf");
}
