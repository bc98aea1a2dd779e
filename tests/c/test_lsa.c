/* The adjustment against closed forms: a weighted mean, a straight line, an angle across north, and what must be refused. */
#include <math.h>
#include <string.h>

#include "angle.h"
#include "expect.h"
#include "lsa.h"

/* Every observation is the one unknown. */
static void one_unknown(const double x[LSA_MAX_UNKNOWNS], double h[LSA_MAX_OBSERVATIONS],
                        double A[LSA_MAX_OBSERVATIONS][LSA_MAX_UNKNOWNS], const void *context)
{
    for (int i = 0; i < *(const int *)context; i++) {
        h[i] = x[0];
        A[i][0] = 1.0;
    }
}

static lsa_observations_t measured(int n, const double *l, const double *variance)
{
    lsa_observations_t o = {.n_observations = n, .n_unknowns = 1};
    for (int i = 0; i < n; i++) {
        o.l[i] = l[i];
        o.Q[i][i] = variance[i];
    }
    return o;
}

static void weighted_mean_has_its_cofactors(void)
{
    const double l[] = {10.0, 13.0, 11.0};
    const double variance[] = {1.0, 2.0, 4.0};
    const int n = 3;
    const lsa_observations_t o = measured(n, l, variance);
    lsa_result_t r = {.x = {0.0}};
    EXPECT(lsa_adjust(&o, one_unknown, &n, &r) == LSA_CONVERGED);
    const double weight = 1.0 + 0.5 + 0.25;
    const double mean = (10.0 + 6.5 + 2.75) / weight;
    EXPECT_NEAR(r.x[0], mean, 1e-12);
    EXPECT_NEAR(r.Qxx[0][0], 1.0 / weight, 1e-12);
    EXPECT(r.degrees == 2);
    double redundancy = 0.0;
    double vPv = 0.0;
    for (int i = 0; i < n; i++) {
        const double qvv = variance[i] - 1.0 / weight;
        EXPECT_NEAR(r.v[i], mean - l[i], 1e-12);
        EXPECT_NEAR(r.l_adjusted[i], mean, 1e-12);
        EXPECT_NEAR(r.Q_adjusted[i][i], 1.0 / weight, 1e-12);
        EXPECT_NEAR(r.Qvv[i][i], qvv, 1e-12);
        EXPECT_NEAR(r.redundancy[i], qvv / variance[i], 1e-12);
        EXPECT_NEAR(r.w[i], (l[i] - mean) / sqrt(qvv), 1e-12);
        redundancy += r.redundancy[i];
        vPv += r.v[i] * r.v[i] / variance[i];
    }
    EXPECT_NEAR(redundancy, 2.0, 1e-12);
    EXPECT_NEAR(r.vPv, vPv, 1e-12);
}

/* Two observations with covariance 0.5 and variances 1, 1.5: weights (Q^-1 e) = (1, 0.5) / 1.25, by hand. */
static void correlated_observations_are_weighed_jointly(void)
{
    const double l[] = {1.0, 4.0};
    const double variance[] = {1.0, 1.5};
    const int n = 2;
    lsa_observations_t o = measured(n, l, variance);
    o.Q[0][1] = o.Q[1][0] = 0.5;
    lsa_result_t r = {.x = {0.0}};
    EXPECT(lsa_adjust(&o, one_unknown, &n, &r) == LSA_CONVERGED);
    EXPECT_NEAR(r.x[0], (1.0 * 1.0 + 0.5 * 4.0) / 1.5, 1e-12);
    EXPECT_NEAR(r.Qxx[0][0], 1.25 / 1.5, 1e-12);
    EXPECT_NEAR(r.redundancy[0] + r.redundancy[1], 1.0, 1e-12);
    EXPECT_NEAR(fabs(r.w[0]), 3.0 / sqrt(1.0 + 1.5 - 2.0 * 0.5), 1e-12); /* w of a difference: 3 over its sigma */
}

static void angles_wrap(void)
{
    const double l[] = {ANGLE_PI - 0.01, -ANGLE_PI + 0.01};
    const double variance[] = {1.0, 1.0};
    const int n = 2;
    lsa_observations_t o = measured(n, l, variance);
    o.angle_rows = 3u;
    lsa_result_t r = {.x = {3.0}};
    EXPECT(lsa_adjust(&o, one_unknown, &n, &r) == LSA_CONVERGED);
    EXPECT_NEAR(r.x[0], ANGLE_PI, 1e-12);
}

/* Position from distances to known points: not linear, so it must iterate. */
static const double points[4][2] = {{0, 0}, {100, 0}, {100, 80}, {0, 90}};

static void distances(const double x[LSA_MAX_UNKNOWNS], double h[LSA_MAX_OBSERVATIONS],
                      double A[LSA_MAX_OBSERVATIONS][LSA_MAX_UNKNOWNS], const void *context)
{
    (void)context;
    for (int i = 0; i < 4; i++) {
        h[i] = hypot(x[0] - points[i][0], x[1] - points[i][1]);
        A[i][0] = (x[0] - points[i][0]) / h[i];
        A[i][1] = (x[1] - points[i][1]) / h[i];
    }
}

static void it_iterates_to_convergence_and_finds_the_blunder(void)
{
    lsa_observations_t o = {.n_observations = 4, .n_unknowns = 2};
    for (int i = 0; i < 4; i++) {
        o.l[i] = hypot(40.0 - points[i][0], 30.0 - points[i][1]);
        o.Q[i][i] = 1e-4;
    }
    lsa_result_t r = {.x = {70.0, 60.0}};
    EXPECT(lsa_adjust(&o, distances, NULL, &r) == LSA_CONVERGED);
    EXPECT(r.iterations > 2);
    EXPECT_NEAR(r.x[0], 40.0, 1e-9);
    EXPECT_NEAR(r.x[1], 30.0, 1e-9);
    EXPECT(r.vPv < 1e-12);

    o.l[2] += 0.5;
    r.x[0] = 70.0;
    EXPECT(lsa_adjust(&o, distances, NULL, &r) == LSA_CONVERGED);
    EXPECT(r.vPv > lsa_critical_chi_square(r.degrees));
    int worst = 0;
    for (int i = 1; i < 4; i++) {
        worst = fabs(r.w[i]) > fabs(r.w[worst]) ? i : worst;
    }
    EXPECT(worst == 2);
    EXPECT(fabs(r.w[2]) > LSA_CRITICAL_W);
}

/* As many observations as unknowns: nothing is controlled, nothing is tested. */
static void without_redundancy_there_is_no_test(void)
{
    const double l[] = {5.0};
    const double variance[] = {4.0};
    const int n = 1;
    const lsa_observations_t o = measured(n, l, variance);
    lsa_result_t r = {.x = {0.0}};
    EXPECT(lsa_adjust(&o, one_unknown, &n, &r) == LSA_CONVERGED);
    EXPECT(isnan(r.w[0]));
    EXPECT(r.degrees == 0);
    EXPECT(isinf(lsa_critical_chi_square(0)));
}

static void what_cannot_be_adjusted_is_said(void)
{
    const double l[] = {5.0, 6.0};
    const double variance[] = {4.0, 1.0};
    const int n = 2;
    lsa_observations_t o = measured(n, l, variance);
    lsa_result_t r = {.x = {0.0}};
    o.l[1] = (double)NAN;
    EXPECT(lsa_adjust(&o, one_unknown, &n, &r) == LSA_REFUSED);
    o.l[1] = 6.0;
    o.Q[1][1] = 0.0;
    EXPECT(lsa_adjust(&o, one_unknown, &n, &r) == LSA_SINGULAR);
    o.Q[1][1] = 1.0;
    o.Q[0][1] = o.Q[1][0] = 2.0;
    EXPECT(lsa_adjust(&o, one_unknown, &n, &r) == LSA_SINGULAR);
    o.n_observations = 1;
    o.n_unknowns = 2;
    EXPECT(lsa_adjust(&o, one_unknown, &n, &r) == LSA_SINGULAR);
}

int main(void)
{
    weighted_mean_has_its_cofactors();
    correlated_observations_are_weighed_jointly();
    angles_wrap();
    it_iterates_to_convergence_and_finds_the_blunder();
    without_redundancy_there_is_no_test();
    what_cannot_be_adjusted_is_said();
    return expect_verdict("lsa");
}
