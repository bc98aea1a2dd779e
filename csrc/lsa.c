#include "lsa.h"

#include <math.h>
#include <string.h>

#include "angle.h"

enum { MAX_OBS = LSA_MAX_OBSERVATIONS, MAX_UNK = LSA_MAX_UNKNOWNS };

/* Corrections below this, in metres and radians, are none. */
static const double converged_below = 1e-10;
/* With less redundancy an error hardly shows: a test would judge rounding. */
static const double no_redundancy = 1e-4;

#if defined(__GNUC__)
#define LSA_INLINE static inline __attribute__((always_inline))
#else
#define LSA_INLINE static inline
#endif

#if defined(__clang__)
#define LSA_UNROLL _Pragma("unroll")
#elif defined(__GNUC__)
#define LSA_UNROLL _Pragma("GCC unroll 10")
#else
#define LSA_UNROLL
#endif

/* Columns and rows of observations are as long as the most there can be, zeros at their ends: loops of a length that the
 * compiler knows take a third less time. */
LSA_INLINE double dot(const double a[MAX_OBS], const double b[MAX_OBS])
{
    double sum[2] = {0.0, 0.0}; /* two at a time */
    LSA_UNROLL
    for (int i = 0; i < MAX_OBS; i += 2) {
        sum[0] += a[i] * b[i];
        sum[1] += a[i + 1] * b[i + 1];
    }
    return sum[0] + sum[1];
}

/* a -= s b */
LSA_INLINE void take_off(double a[MAX_OBS], double s, const double b[MAX_OBS])
{
    LSA_UNROLL
    for (int i = 0; i < MAX_OBS; i++) {
        a[i] -= s * b[i];
    }
}

/* The Cholesky factor L of Q and G = L^-1, so that G Q G' = I and Q^-1 = G' G. Returns 0 when Q is no covariance. */
static int whitening(const lsa_observations_t *o, double L[MAX_OBS][MAX_OBS], double G[MAX_OBS][MAX_OBS])
{
    for (int i = 0; i < o->n_observations; i++) {
        int first = 0; /* most observations are correlated with none before them */
        while (first < i && o->Q[i][first] == 0.0) {
            first++;
        }
        double square = o->Q[i][i];
        for (int j = first; j < i; j++) {
            double s = o->Q[i][j];
            for (int k = first; k < j; k++) {
                s -= L[i][k] * L[j][k];
            }
            L[i][j] = s * G[j][j];
            square -= L[i][j] * L[i][j];
        }
        if (!(square > 0.0) || !isfinite(square)) {
            return 0;
        }
        L[i][i] = sqrt(square);
        G[i][i] = 1.0 / L[i][i];
        for (int j = 0; j < i && first < i; j++) {
            double s = 0.0;
            for (int k = j > first ? j : first; k < i; k++) {
                s -= L[i][k] * G[k][j];
            }
            G[i][j] = s * G[i][i];
        }
    }
    return 1;
}

/* B = E R with orthonormal columns E, in the place of B, by modified Gram-Schmidt; R with the reciprocals of its diagonal
 * in that diagonal's place. Matrices are kept by columns. Returns 0 when B has not full rank. */
LSA_INLINE int orthonormalise(double B[MAX_UNK][MAX_OBS], int u, double R[MAX_UNK][MAX_UNK])
{
    for (int c = 0; c < u; c++) {
        const double after = dot(B[c], B[c]);
        double before = after;
        for (int d = 0; d < c; d++) {
            before += R[d][c] * R[d][c];
        }
        if (!(after > 1e-24 * before) || !isfinite(after)) {
            return 0;
        }
        R[c][c] = 1.0 / sqrt(after);
        LSA_UNROLL
        for (int i = 0; i < MAX_OBS; i++) {
            B[c][i] *= R[c][c];
        }
        for (int d = c + 1; d < u; d++) {
            R[c][d] = dot(B[c], B[d]);
            take_off(B[d], R[c][d], B[c]);
        }
    }
    return 1;
}

/* The inverse of R as orthonormalise() leaves it, upper triangle. */
LSA_INLINE void invert(const double R[MAX_UNK][MAX_UNK], int u, double inverse[MAX_UNK][MAX_UNK])
{
    for (int c = 0; c < u; c++) {
        inverse[c][c] = R[c][c];
        for (int d = c - 1; d >= 0; d--) {
            double s = 0.0;
            for (int k = d + 1; k <= c; k++) {
                s -= R[d][k] * inverse[k][c];
            }
            inverse[d][c] = s * R[d][d];
        }
    }
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

/* One Gauss-Newton step from the misclosures, on whitened observations; E gets the whitened design's orthonormal columns,
 * R the triangle that goes with them and b the whitened misclosures. The normal equations would square the condition, and
 * at walking pace the digits would not suffice; b, orthogonalised like a column more, loses none to what E lacks in
 * orthogonality. The largest correction, negative when singular. */
LSA_INLINE double correct(const lsa_observations_t *o, int u, const double G[MAX_OBS][MAX_OBS],
                          const double A[MAX_OBS][MAX_UNK], const double dl[MAX_OBS], double E[MAX_UNK][MAX_OBS],
                          double R[MAX_UNK][MAX_UNK], double b[MAX_OBS], double x[MAX_UNK])
{
    const int n = o->n_observations;
    for (int i = n; i < MAX_OBS; i++) {
        b[i] = 0.0;
        for (int c = 0; c < u; c++) {
            E[c][i] = 0.0;
        }
    }
    for (int i = 0; i < n; i++) {
        b[i] = G[i][i] * dl[i];
        for (int c = 0; c < u; c++) {
            E[c][i] = G[i][i] * A[i][c];
        }
        for (int k = 0; k < i; k++) {
            if (G[i][k] != 0.0) {
                b[i] += G[i][k] * dl[k];
                for (int c = 0; c < u; c++) {
                    E[c][i] += G[i][k] * A[k][c];
                }
            }
        }
    }
    if (!orthonormalise(E, u, R)) {
        return -1.0;
    }
    double rest[MAX_OBS];
    double dx[MAX_UNK];
    memcpy(rest, b, sizeof rest);
    for (int c = 0; c < u; c++) {
        dx[c] = dot(E[c], rest);
        take_off(rest, dx[c], E[c]);
    }
    double largest = 0.0;
    for (int c = u - 1; c >= 0; c--) {
        for (int d = c + 1; d < u; d++) {
            dx[c] -= R[c][d] * dx[d];
        }
        dx[c] *= R[c][c];
        x[c] += dx[c];
        largest = !(fabs(dx[c]) <= largest) ? fabs(dx[c]) : largest; /* NaN stays */
    }
    return isfinite(largest) ? largest : -1.0;
}

/* Cofactors of the unknowns. E is orthonormalised once more: the first time it is so only as far as the condition lets
 * it. */
LSA_INLINE int unknowns_cofactors(int u, double E[MAX_UNK][MAX_OBS], const double R[MAX_UNK][MAX_UNK],
                                  double Qxx[MAX_UNK][MAX_UNK])
{
    double again[MAX_UNK][MAX_UNK];
    double first[MAX_UNK][MAX_UNK];
    double second[MAX_UNK][MAX_UNK];
    double inverse[MAX_UNK][MAX_UNK];
    if (!orthonormalise(E, u, again)) {
        return 0;
    }
    invert(R, u, first);
    invert((const double(*)[MAX_UNK])again, u, second);
    for (int c = 0; c < u; c++) {
        for (int d = c; d < u; d++) {
            inverse[c][d] = 0.0;
            for (int k = c; k <= d; k++) {
                inverse[c][d] += first[c][k] * second[k][d];
            }
        }
        for (int d = 0; d <= c; d++) {
            Qxx[c][d] = 0.0;
        }
    }
    for (int c = 0; c < u; c++) {
        for (int d = 0; d <= c; d++) {
            for (int k = c; k < u; k++) {
                Qxx[c][d] += inverse[c][k] * inverse[d][k];
            }
            Qxx[d][c] = Qxx[c][d];
        }
    }
    return 1;
}

/* Residuals, cofactors and tests at the adjusted unknowns, from M = I - E E', which takes the residuals out of whitened
 * misclosures: no differences of numbers that are nearly the same. */
LSA_INLINE void judge(const lsa_observations_t *o, int u, const double L[MAX_OBS][MAX_OBS],
                      const double G[MAX_OBS][MAX_OBS], const double E[MAX_UNK][MAX_OBS], const double b[MAX_OBS],
                      const double dl[MAX_OBS], lsa_result_t *r)
{
    const int n = o->n_observations;
    double M[MAX_OBS][MAX_OBS];
    double LM[MAX_OBS][MAX_OBS];
    double rest[MAX_OBS]; /* whitened residuals, negative */
    r->vPv = 0.0;
    for (int i = 0; i < n; i++) {
        memset(M[i], 0, sizeof M[i]);
        M[i][i] = 1.0;
        for (int c = 0; c < u; c++) {
            take_off(M[i], E[c][i], E[c]);
        }
        rest[i] = dot(M[i], b);
        r->vPv += rest[i] * rest[i];
        memset(LM[i], 0, sizeof LM[i]);
        for (int k = 0; k <= i; k++) {
            if (L[i][k] != 0.0) {
                take_off(LM[i], -L[i][k], M[k]);
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
        for (int j = 0; j <= i; j++) {
            double s = LM[i][j] * L[j][j];
            for (int k = 0; k < j; k++) {
                if (L[j][k] != 0.0) {
                    s += LM[i][k] * L[j][k];
                }
            }
            r->Qvv[i][j] = r->Qvv[j][i] = s;
            r->Q_adjusted[i][j] = r->Q_adjusted[j][i] = o->Q[i][j] - s;
        }
        for (int j = i; j < n; j++) {
            if (G[j][i] != 0.0) {
                double MG = 0.0;
                for (int k = i; k < n; k++) {
                    MG += G[k][i] != 0.0 ? M[j][k] * G[k][i] : 0.0;
                }
                r->redundancy[i] += LM[i][j] * G[j][i];
                Pv -= G[j][i] * rest[j];
                P += G[j][i] * G[j][i];
                PQP += G[j][i] * MG;
            }
        }
        r->w[i] = r->redundancy[i] > no_redundancy && PQP > no_redundancy * P ? -Pv / sqrt(PQP) : (double)NAN;
    }
    r->degrees = n - u;
}

LSA_INLINE lsa_status_t adjust(const lsa_observations_t *o, int u, lsa_model_t model, const void *context,
                               lsa_result_t *result)
{
    double L[MAX_OBS][MAX_OBS] = {{0}};
    double G[MAX_OBS][MAX_OBS] = {{0}};
    double E[MAX_UNK][MAX_OBS];
    double R[MAX_UNK][MAX_UNK];
    double b[MAX_OBS];
    double A[MAX_OBS][MAX_UNK];
    double h[MAX_OBS];
    double dl[MAX_OBS];
    if (!whitening(o, L, G)) {
        return LSA_SINGULAR;
    }
    for (result->iterations = 1; result->iterations <= LSA_MAX_ITERATIONS; result->iterations++) {
        model(result->x, h, A, context);
        misclosures(o, h, dl);
        const double largest =
            correct(o, u, (const double(*)[MAX_OBS])G, (const double(*)[MAX_UNK])A, dl, E, R, b, result->x);
        if (largest < 0.0) {
            return LSA_SINGULAR;
        }
        if (largest < converged_below) {
            if (!unknowns_cofactors(u, E, (const double(*)[MAX_UNK])R, result->Qxx)) {
                return LSA_SINGULAR;
            }
            judge(o, u, (const double(*)[MAX_OBS])L, (const double(*)[MAX_OBS])G, (const double(*)[MAX_OBS])E, b, dl,
                  result);
            return LSA_CONVERGED;
        }
    }
    return LSA_DIVERGED;
}

lsa_status_t lsa_adjust(const lsa_observations_t *o, lsa_model_t model, const void *context, lsa_result_t *result)
{
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
    if (o->n_observations < o->n_unknowns) {
        return LSA_SINGULAR;
    }
    /* The vehicle's five unknowns, known to the compiler, unroll as well. */
    return o->n_unknowns == 5 ? adjust(o, 5, model, context, result) : adjust(o, o->n_unknowns, model, context, result);
}

double lsa_critical_chi_square(int degrees)
{
    static const double critical[] = {10.827566170662733, 13.815510557964274, 16.26623619623813,  18.466826952903151,
                                      20.515005652432873, 22.457744484825323, 24.321886347856854, 26.12448155837614,
                                      27.877164871256568, 29.588298445074415};
    return degrees >= 1 && degrees <= MAX_OBS ? critical[degrees - 1] : (double)INFINITY;
}
