/* TinyEKF's newer form: predict and update apart, sizes constants, intermediates on the stack. */
#include "tinyekf_matrices.h"

enum { N = TINYEKF_N, M = TINYEKF_M };

static void predict(tinyekf_static_t *ekf, const double *fx, const double *F, const double *Q)
{
    double FP[N * N];
    double Ft[N * N];
    double FPFt[N * N];
    memcpy(ekf->x, fx, sizeof ekf->x);
    multiply(F, ekf->P, FP, N, N, N);
    transpose(F, Ft, N, N);
    multiply(FP, Ft, FPFt, N, N, N);
    combine(FPFt, Q, 1, ekf->P, N * N);
}

static int update(tinyekf_static_t *ekf, const double *z, const double *hx, const double *H, const double *R)
{
    double Ht[N * M];
    double PHt[N * M];
    double HP[M * N];
    double S[M * M];
    double inverse[M * M];
    double diagonal[M];
    double G[N * M];
    transpose(H, Ht, M, N);
    multiply(ekf->P, Ht, PHt, N, N, M);
    multiply(H, ekf->P, HP, M, N, N);
    multiply(HP, Ht, S, M, N, M);
    combine(S, R, 1, S, M * M);
    if (invert(S, inverse, diagonal, M)) {
        return 1;
    }
    multiply(PHt, inverse, G, N, M, M);

    double innovation[M];
    double correction[N];
    combine(z, hx, -1, innovation, M);
    multiply(G, innovation, correction, N, M, 1);
    combine(ekf->x, correction, 1, ekf->x, N);

    double GH[N * N];
    double P[N * N];
    multiply(G, H, GH, N, M, N);
    from_identity(GH, N);
    multiply(GH, ekf->P, P, N, N, N);
    memcpy(ekf->P, P, sizeof P);
    return 0;
}

int tinyekf_static_step(tinyekf_static_t *ekf, const tinyekf_step_t *step)
{
    double hx[M];
    predict(ekf, step->fx, step->F, step->Q);
    multiply(step->H, ekf->x, hx, M, N, 1);
    return update(ekf, step->z, hx, step->H, step->R);
}

int tinyekf_static_boat(tinyekf_static_t *ekf, double u, double rate, double dt, const double q[3], const double z[3],
                        const double r[3])
{
    tinyekf_step_t step;
    boat_step(&step, ekf->x, u, rate, dt, q, r);
    memcpy(step.z, z, sizeof step.z);
    return tinyekf_static_step(ekf, &step);
}
