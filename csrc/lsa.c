#include "lsa.h"

#include <math.h>

#include "angle.h"

enum { MAX_OBS = LSA_MAX_OBSERVATIONS, MAX_UNK = LSA_MAX_UNKNOWNS };

/* Corrections below this, in metres and radians, are none. */
static const double converged_below = 1e-10;
/* With less redundancy an error hardly shows: a test would judge rounding. */
static const double no_redundancy = 1e-4;

/* The Cholesky factor L of Q and G = L^-1, so that G Q G' = I and Q^-1 = G' G. Returns 0 when Q is no covariance. */
static int whitening(const lsa_observations_t *o, double L[MAX_OBS][MAX_OBS], double G[MAX_OBS][MAX_OBS])
{
    for (int i = 0; i < o->n_observations; i++) {
        for (int j = 0; j <= i; j++) {
            double s = o->Q[i][j];
            for (int k = 0; k < j; k++) {
                s -= L[i][k] * L[j][k];
            }
            if (j < i) {
                L[i][j] = s / L[j][j];
            } else if (s > 0.0 && isfinite(s)) {
                L[i][i] = sqrt(s);
            } else {
                return 0;
            }
        }
        G[i][i] = 1.0 / L[i][i];
        for (int j = 0; j < i; j++) {
            double s = 0.0;
            for (int k = j; k < i; k++) {
                s -= L[i][k] * G[k][j];
            }
            G[i][j] = s * G[i][i];
        }
    }
    return 1;
}

/* B = E R with orthonormal columns E, in the place of B, by Gram-Schmidt done twice; and the inverse of R. The normal
 * equations would square the condition, and at walking pace the digits would not suffice. Returns 0 when B has not full
 * rank. */
static int orthonormalise(double B[MAX_OBS][MAX_UNK], int n, int u, double inverse[MAX_UNK][MAX_UNK])
{
    double R[MAX_UNK][MAX_UNK] = {{0}};
    for (int c = 0; c < u; c++) {
        double before = 0.0;
        for (int i = 0; i < n; i++) {
            before += B[i][c] * B[i][c];
        }
        for (int pass = 0; pass < 2; pass++) {
            for (int d = 0; d < c; d++) {
                double s = 0.0;
                for (int i = 0; i < n; i++) {
                    s += B[i][d] * B[i][c];
                }
                R[d][c] += s;
                for (int i = 0; i < n; i++) {
                    B[i][c] -= s * B[i][d];
                }
            }
        }
        double after = 0.0;
        for (int i = 0; i < n; i++) {
            after += B[i][c] * B[i][c];
        }
        if (!(after > 1e-24 * before) || !isfinite(after)) {
            return 0;
        }
        R[c][c] = sqrt(after);
        for (int i = 0; i < n; i++) {
            B[i][c] /= R[c][c];
        }
    }
    for (int c = 0; c < u; c++) {
        inverse[c][c] = 1.0 / R[c][c];
        for (int d = c - 1; d >= 0; d--) {
            double s = 0.0;
            for (int k = d + 1; k <= c; k++) {
                s -= R[d][k] * inverse[k][c];
            }
            inverse[d][c] = s / R[d][d];
        }
    }
    return 1;
}

/* l - h(x), angles wrapped. */
static void misclosures(const lsa_observations_t *o, const double h[MAX_OBS], double dl[MAX_OBS])
{
    for (int i = 0; i < o->n_observations; i++) {
        dl[i] = o->l[i] - h[i];
        if (o->angle_rows >> i & 1u) {
            dl[i] = angle_wrap(dl[i]);
        }
    }
}

/* One Gauss-Newton step from the misclosures, on whitened observations; E gets the whitened design's orthonormal columns
 * and b the whitened misclosures. The largest correction, negative when singular. */
static double correct(const lsa_observations_t *o, const double G[MAX_OBS][MAX_OBS], const double A[MAX_OBS][MAX_UNK],
                      const double dl[MAX_OBS], double E[MAX_OBS][MAX_UNK], double b[MAX_OBS], lsa_result_t *result)
{
    const int n = o->n_observations;
    const int u = o->n_unknowns;
    for (int i = 0; i < n; i++) {
        b[i] = 0.0;
        for (int c = 0; c < u; c++) {
            E[i][c] = 0.0;
        }
        for (int k = 0; k <= i; k++) {
            if (G[i][k] != 0.0) {
                b[i] += G[i][k] * dl[k];
                for (int c = 0; c < u; c++) {
                    E[i][c] += G[i][k] * A[k][c];
                }
            }
        }
    }
    double inverse[MAX_UNK][MAX_UNK] = {{0}};
    if (!orthonormalise(E, n, u, inverse)) {
        return -1.0;
    }
    double along[MAX_UNK];
    for (int c = 0; c < u; c++) {
        along[c] = 0.0;
        for (int i = 0; i < n; i++) {
            along[c] += E[i][c] * b[i];
        }
    }
    double largest = 0.0;
    for (int c = 0; c < u; c++) {
        double dx = 0.0;
        for (int d = c; d < u; d++) {
            dx += inverse[c][d] * along[d];
        }
        result->x[c] += dx;
        largest = fmax(largest, fabs(dx));
        for (int d = 0; d <= c; d++) {
            double s = 0.0;
            for (int k = c; k < u; k++) {
                s += inverse[c][k] * inverse[d][k];
            }
            result->Qxx[c][d] = result->Qxx[d][c] = s;
        }
    }
    return isfinite(largest) ? largest : -1.0;
}

/* Residuals, cofactors and tests at the adjusted unknowns, from M = I - E E', which takes the residuals out of whitened
 * misclosures: no differences of numbers that are nearly the same. */
static void judge(const lsa_observations_t *o, const double L[MAX_OBS][MAX_OBS], const double G[MAX_OBS][MAX_OBS],
                  const double E[MAX_OBS][MAX_UNK], const double b[MAX_OBS], const double dl[MAX_OBS], lsa_result_t *r)
{
    const int n = o->n_observations;
    double M[MAX_OBS][MAX_OBS];
    double LM[MAX_OBS][MAX_OBS];
    double rest[MAX_OBS]; /* whitened residuals, negative */
    r->vPv = 0.0;
    for (int i = 0; i < n; i++) {
        rest[i] = 0.0;
        for (int j = 0; j < n; j++) {
            M[i][j] = i == j;
            for (int c = 0; c < o->n_unknowns; c++) {
                M[i][j] -= E[i][c] * E[j][c];
            }
            rest[i] += M[i][j] * b[j];
        }
        r->vPv += rest[i] * rest[i];
    }
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            LM[i][j] = 0.0;
            for (int k = 0; k <= i; k++) {
                LM[i][j] += L[i][k] * M[k][j];
            }
        }
    }
    for (int i = 0; i < n; i++) {
        double Pv = 0.0;
        double PQP = 0.0;
        double P = 0.0;
        r->v[i] = -dl[i];
        r->l_adjusted[i] = o->l[i] + r->v[i];
        r->redundancy[i] = 0.0;
        for (int j = 0; j < n; j++) {
            double s = 0.0;
            for (int k = 0; k <= j; k++) {
                s += LM[i][k] * L[j][k];
            }
            r->Qvv[i][j] = s;
            r->Q_adjusted[i][j] = o->Q[i][j] - s;
            if (j >= i && G[j][i] != 0.0) {
                r->redundancy[i] += LM[i][j] * G[j][i];
                Pv -= G[j][i] * rest[j];
                P += G[j][i] * G[j][i];
                for (int k = i; k < n; k++) {
                    PQP += G[j][i] * M[j][k] * G[k][i];
                }
            }
        }
        r->w[i] = r->redundancy[i] > no_redundancy && PQP > no_redundancy * P ? -Pv / sqrt(PQP) : (double)NAN;
    }
    r->degrees = n - o->n_unknowns;
}

lsa_status_t lsa_adjust(const lsa_observations_t *o, lsa_model_t model, const void *context, lsa_result_t *result)
{
    double L[MAX_OBS][MAX_OBS] = {{0}};
    double G[MAX_OBS][MAX_OBS] = {{0}};
    double E[MAX_OBS][MAX_UNK];
    double b[MAX_OBS];
    double A[MAX_OBS][MAX_UNK];
    double h[MAX_OBS];
    double dl[MAX_OBS];
    double sum = 0.0;
    for (int i = 0; i < o->n_observations; i++) {
        sum += o->l[i] - o->l[i];
    }
    for (int c = 0; c < o->n_unknowns; c++) {
        sum += result->x[c] - result->x[c];
    }
    if (sum != 0.0) {
        return LSA_REFUSED;
    }
    if (o->n_observations < o->n_unknowns || !whitening(o, L, G)) {
        return LSA_SINGULAR;
    }
    for (result->iterations = 1; result->iterations <= LSA_MAX_ITERATIONS; result->iterations++) {
        model(result->x, h, A, context);
        misclosures(o, h, dl);
        const double largest = correct(o, (const double(*)[MAX_OBS])G, (const double(*)[MAX_UNK])A, dl, E, b, result);
        if (largest < 0.0) {
            return LSA_SINGULAR;
        }
        if (largest < converged_below) {
            judge(o, (const double(*)[MAX_OBS])L, (const double(*)[MAX_OBS])G, (const double(*)[MAX_UNK])E, b, dl,
                  result);
            return LSA_CONVERGED;
        }
    }
    return LSA_DIVERGED;
}

double lsa_critical_chi_square(int degrees)
{
    static const double critical[] = {10.827566170662733, 13.815510557964274, 16.26623619623813,  18.466826952903151,
                                      20.515005652432873, 22.457744484825323, 24.321886347856854, 26.12448155837614,
                                      27.877164871256568, 29.588298445074415};
    return degrees >= 1 && degrees <= MAX_OBS ? critical[degrees - 1] : (double)INFINITY;
}
