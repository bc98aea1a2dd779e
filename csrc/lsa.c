#include "lsa.h"

#include <math.h>

#include "angle.h"

enum { MAX_OBS = LSA_MAX_OBSERVATIONS, MAX_UNK = LSA_MAX_UNKNOWNS };

/* Corrections below this, in metres and radians, are none. */
static const double converged_below = 1e-10;
/* Redundancy numbers below this are 0 but for rounding. */
static const double no_redundancy = 1e-9;

/* G = L^-1 of the Cholesky factor L of Q, so that G Q G' = I and Q^-1 = G' G. Returns 0 when Q is no covariance. */
static int whitening(const lsa_observations_t *o, double G[MAX_OBS][MAX_OBS])
{
    double L[MAX_OBS][MAX_OBS];
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

/* Qxx = N^-1 of a symmetric positive definite N of size n, by Cholesky. Returns 0 when it is not. */
static int invert(const double N[MAX_UNK][MAX_UNK], int n, double inverse[MAX_UNK][MAX_UNK])
{
    double L[MAX_UNK][MAX_UNK];
    double G[MAX_UNK][MAX_UNK] = {{0}};
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            double s = N[i][j];
            for (int k = 0; k < j; k++) {
                s -= L[i][k] * L[j][k];
            }
            if (j < i) {
                L[i][j] = s / L[j][j];
            } else if (s > 1e-14 * N[i][i] && isfinite(s)) {
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
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            double s = 0.0;
            for (int k = i; k < n; k++) {
                s += G[k][i] * G[k][j];
            }
            inverse[i][j] = inverse[j][i] = s;
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

/* One Gauss-Newton step from the misclosures; the largest correction, negative when singular. */
static double correct(const lsa_observations_t *o, const double G[MAX_OBS][MAX_OBS], const double A[MAX_OBS][MAX_UNK],
                      const double dl[MAX_OBS], lsa_result_t *result)
{
    const int n = o->n_observations;
    const int u = o->n_unknowns;
    double B[MAX_OBS][MAX_UNK];
    double N[MAX_UNK][MAX_UNK];
    double rhs[MAX_UNK] = {0};
    double b[MAX_OBS];
    for (int i = 0; i < n; i++) {
        b[i] = 0.0;
        for (int c = 0; c < u; c++) {
            B[i][c] = 0.0;
        }
        for (int k = 0; k <= i; k++) {
            if (G[i][k] != 0.0) {
                b[i] += G[i][k] * dl[k];
                for (int c = 0; c < u; c++) {
                    B[i][c] += G[i][k] * A[k][c];
                }
            }
        }
    }
    for (int c = 0; c < u; c++) {
        for (int d = 0; d <= c; d++) {
            double s = 0.0;
            for (int i = 0; i < n; i++) {
                s += B[i][c] * B[i][d];
            }
            N[c][d] = N[d][c] = s;
        }
        for (int i = 0; i < n; i++) {
            rhs[c] += B[i][c] * b[i];
        }
    }
    if (!invert((const double(*)[MAX_UNK])N, u, result->Qxx)) {
        return -1.0;
    }
    double largest = 0.0;
    for (int c = 0; c < u; c++) {
        double dx = 0.0;
        for (int d = 0; d < u; d++) {
            dx += result->Qxx[c][d] * rhs[d];
        }
        result->x[c] += dx;
        largest = fmax(largest, fabs(dx));
    }
    return isfinite(largest) ? largest : -1.0;
}

/* Residuals, cofactors and tests at the adjusted unknowns. */
static void judge(const lsa_observations_t *o, const double G[MAX_OBS][MAX_OBS], const double A[MAX_OBS][MAX_UNK],
                  const double dl[MAX_OBS], lsa_result_t *r)
{
    const int n = o->n_observations;
    const int u = o->n_unknowns;
    double P[MAX_OBS][MAX_OBS];
    for (int i = 0; i < n; i++) {
        r->v[i] = -dl[i];
        r->l_adjusted[i] = o->l[i] + r->v[i];
        double AQ[MAX_UNK];
        for (int c = 0; c < u; c++) {
            AQ[c] = 0.0;
            for (int d = 0; d < u; d++) {
                AQ[c] += A[i][d] * r->Qxx[d][c];
            }
        }
        for (int j = 0; j <= i; j++) {
            double s = 0.0;
            for (int c = 0; c < u; c++) {
                s += AQ[c] * A[j][c];
            }
            r->Q_adjusted[i][j] = r->Q_adjusted[j][i] = s;
            r->Qvv[i][j] = r->Qvv[j][i] = o->Q[i][j] - s;
            double p = 0.0;
            for (int k = i; k < n; k++) {
                p += G[k][i] * G[k][j];
            }
            P[i][j] = P[j][i] = p;
        }
    }
    r->vPv = 0.0;
    for (int i = 0; i < n; i++) {
        double Pv = 0.0;
        double PQP = 0.0;
        r->redundancy[i] = 0.0;
        for (int j = 0; j < n; j++) {
            if (P[i][j] == 0.0) {
                continue;
            }
            Pv += P[i][j] * r->v[j];
            r->redundancy[i] += r->Qvv[i][j] * P[j][i];
            for (int k = 0; k < n; k++) {
                PQP += P[i][j] * r->Qvv[j][k] * P[k][i];
            }
        }
        r->vPv += r->v[i] * Pv;
        /* The test divides by sqrt(P Qvv P): as a share of P it is rounding alone where nothing controls the row. */
        r->w[i] = r->redundancy[i] > no_redundancy && PQP > no_redundancy * P[i][i] ? -Pv / sqrt(PQP) : (double)NAN;
    }
    r->degrees = n - u;
}

lsa_status_t lsa_adjust(const lsa_observations_t *o, lsa_model_t model, const void *context, lsa_result_t *result)
{
    double G[MAX_OBS][MAX_OBS] = {{0}};
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
    if (o->n_observations < o->n_unknowns || !whitening(o, G)) {
        return LSA_SINGULAR;
    }
    for (result->iterations = 1; result->iterations <= LSA_MAX_ITERATIONS; result->iterations++) {
        model(result->x, h, A, context);
        misclosures(o, h, dl);
        const double largest = correct(o, (const double(*)[MAX_OBS])G, (const double(*)[MAX_UNK])A, dl, result);
        if (largest < 0.0) {
            return LSA_SINGULAR;
        }
        if (largest < converged_below) {
            judge(o, (const double(*)[MAX_OBS])G, (const double(*)[MAX_UNK])A, dl, result);
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
