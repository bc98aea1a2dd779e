#include "covariance_intersection.h"

#include <math.h>

#include "angle.h"

enum { N = 3, HALVINGS = 60 };
static const double flat = 1e-9; /* relative derivative below which any omega is as good */

/* Inverse of a symmetric positive definite matrix by its adjugate; 0 when its determinant is not positive. */
static int invert(const double M[N][N], double inverse[N][N])
{
    const double c00 = M[1][1] * M[2][2] - M[1][2] * M[1][2];
    const double c01 = M[0][2] * M[1][2] - M[0][1] * M[2][2];
    const double c02 = M[0][1] * M[1][2] - M[0][2] * M[1][1];
    const double det = M[0][0] * c00 + M[0][1] * c01 + M[0][2] * c02;
    if (!(det > 0.0 && det < INFINITY)) {
        return 0;
    }
    const double scale = 1.0 / det;
    inverse[0][0] = c00 * scale;
    inverse[0][1] = inverse[1][0] = c01 * scale;
    inverse[0][2] = inverse[2][0] = c02 * scale;
    inverse[1][1] = (M[0][0] * M[2][2] - M[0][2] * M[0][2]) * scale;
    inverse[1][2] = inverse[2][1] = (M[0][1] * M[0][2] - M[0][0] * M[1][2]) * scale;
    inverse[2][2] = (M[0][0] * M[1][1] - M[0][1] * M[0][1]) * scale;
    return 1;
}

/* C for one omega. */
static int intersect(const double Ai[N][N], const double Bi[N][N], double omega, double C[N][N])
{
    double information[N][N];
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++) {
            information[i][j] = omega * Ai[i][j] + (1.0 - omega) * Bi[i][j];
        }
    }
    return invert((const double(*)[N])information, C);
}

/* Derivative of the objective by omega, relative to the objective where that is the trace (log det is relative already).
 * d C / d omega = -C (A^-1 - B^-1) C. */
static double derivative(const double Ai[N][N], const double Bi[N][N], double omega, ci_objective_t objective)
{
    double C[N][N];
    if (!intersect(Ai, Bi, omega, C)) {
        return NAN;
    }
    double sum = 0.0;
    double trace = 0.0;
    for (int i = 0; i < N; i++) {
        trace += C[i][i];
        for (int j = 0; j < N; j++) {
            double weight = C[i][j]; /* log det: C; trace: C C */
            if (objective == CI_MINIMISE_TRACE) {
                weight = C[i][0] * C[0][j] + C[i][1] * C[1][j] + C[i][2] * C[2][j];
            }
            sum -= weight * (Ai[i][j] - Bi[i][j]);
        }
    }
    return objective == CI_MINIMISE_TRACE ? sum / trace : sum;
}

static double best_omega(const double Ai[N][N], const double Bi[N][N], ci_objective_t objective)
{
    const double at_b = derivative(Ai, Bi, 0.0, objective);
    const double at_a = derivative(Ai, Bi, 1.0, objective);
    if (fabs(at_b) < flat && fabs(at_a) < flat) {
        return 0.5;
    }
    if (at_b >= 0.0) {
        return 0.0;
    }
    if (at_a <= 0.0) {
        return 1.0;
    }
    double low = 0.0;
    double high = 1.0;
    for (int i = 0; i < HALVINGS; i++) {
        const double middle = 0.5 * (low + high);
        if (middle <= low || middle >= high) {
            break;
        }
        if (derivative(Ai, Bi, middle, objective) < 0.0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return 0.5 * (low + high);
}

static void widen(const ekf_real P[N][N], double wide[N][N])
{
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++) {
            wide[i][j] = (double)P[i][j];
        }
    }
}

ekf_status_t covariance_intersection(const ekf_t *a, const ekf_t *b, ci_objective_t objective, ekf_t *out,
                                     double *omega)
{
    double A[N][N];
    double B[N][N];
    double Ai[N][N];
    double Bi[N][N];
    double C[N][N];
    widen(a->P, A);
    widen(b->P, B);
    if (!invert((const double(*)[N])A, Ai) || !invert((const double(*)[N])B, Bi)) {
        return EKF_FAILED;
    }
    const double w = best_omega((const double(*)[N])Ai, (const double(*)[N])Bi, objective);
    if (!intersect((const double(*)[N])Ai, (const double(*)[N])Bi, w, C)) {
        return EKF_FAILED;
    }
    double difference[N]; /* b - a: c = a + (1-w) C B^-1 (b - a) */
    for (int i = 0; i < N; i++) {
        difference[i] = (double)b->x[i] - (double)a->x[i];
        if (a->angle_states >> i & 1u) {
            difference[i] = angle_wrap(difference[i]);
        }
    }
    ekf_real x[N];
    ekf_real P[N][N];
    for (int i = 0; i < N; i++) {
        double shift = 0.0;
        for (int j = 0; j < N; j++) {
            for (int k = 0; k < N; k++) {
                shift += C[i][j] * Bi[j][k] * difference[k];
            }
            P[i][j] = (ekf_real)(0.5 * (C[i][j] + C[j][i]));
        }
        x[i] = (ekf_real)((double)a->x[i] + (1.0 - w) * shift);
    }
    const ekf_status_t status = ekf_init(out, x, (const ekf_real(*)[N])P, a->angle_states);
    if (status == EKF_ACCEPTED && omega) {
        *omega = w;
    }
    return status;
}
