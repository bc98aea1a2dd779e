/* The peer: TinyEKF's algorithm (github.com/simondlevy/TinyEKF), written anew from its description, in its two forms.
 *
 *     predict  x = fx, P = F P F' + Q
 *     update   G = P H' (H P H' + R)^-1 by Cholesky, x += G (z - hx), P = (I - G H) P
 *
 * Matrices are stored row by row. A step returns 0, or 1 when Cholesky's method fails. */
#ifndef TINYEKF_H
#define TINYEKF_H

enum { TINYEKF_N = 3, TINYEKF_M = 3 };

/* What a step is given. */
typedef struct {
    double z[TINYEKF_M];
    double fx[TINYEKF_N];
    double F[TINYEKF_N * TINYEKF_N];
    double Q[TINYEKF_N * TINYEKF_N];
    double H[TINYEKF_M * TINYEKF_N];
    double R[TINYEKF_M * TINYEKF_M];
} tinyekf_step_t;

/* The older form: one library for all sizes, which are numbers read at run time. */
typedef struct {
    int n, m;
    double x[TINYEKF_N], P[TINYEKF_N * TINYEKF_N];
    double Ft[TINYEKF_N * TINYEKF_N], Ht[TINYEKF_N * TINYEKF_M], Pp[TINYEKF_N * TINYEKF_N], G[TINYEKF_N * TINYEKF_M];
    double hx[TINYEKF_M];
    double nn[TINYEKF_N * TINYEKF_N], nm[TINYEKF_N * TINYEKF_M], mn[TINYEKF_M * TINYEKF_N];
    double S[TINYEKF_M * TINYEKF_M], inverse[TINYEKF_M * TINYEKF_M], m1[TINYEKF_M], n1[TINYEKF_N];
} tinyekf_generic_t;

int tinyekf_generic_step(tinyekf_generic_t *ekf, const tinyekf_step_t *step);

/* The newer form: a header, compiled with the model, its sizes constants. */
typedef struct {
    double x[TINYEKF_N], P[TINYEKF_N * TINYEKF_N];
} tinyekf_static_t;

int tinyekf_static_step(tinyekf_static_t *ekf, const tinyekf_step_t *step);

/* The step of the boat's model (heading_model.h) on either: sin and cos, then F, Q, H, R, then the step. */
int tinyekf_generic_boat(tinyekf_generic_t *ekf, double u, double rate, double dt, const double q[3], const double z[3],
                         const double r[3]);
int tinyekf_static_boat(tinyekf_static_t *ekf, double u, double rate, double dt, const double q[3], const double z[3],
                        const double r[3]);

#endif
