/* TinyEKF's older form: sizes read at run time, every intermediate kept in the filter's struct. */
#include "tinyekf_matrices.h"

int tinyekf_generic_step(tinyekf_generic_t *e, const tinyekf_step_t *step)
{
    const int n = e->n;
    const int m = e->m;
    multiply(step->F, e->P, e->nn, n, n, n);
    transpose(step->F, e->Ft, n, n);
    multiply(e->nn, e->Ft, e->Pp, n, n, n);
    combine(e->Pp, step->Q, 1, e->Pp, n * n);

    transpose(step->H, e->Ht, m, n);
    multiply(e->Pp, e->Ht, e->nm, n, n, m);
    multiply(step->H, e->Pp, e->mn, m, n, n);
    multiply(e->mn, e->Ht, e->S, m, n, m);
    combine(e->S, step->R, 1, e->S, m * m);
    if (invert(e->S, e->inverse, e->m1, m)) {
        return 1;
    }
    multiply(e->nm, e->inverse, e->G, n, m, m);

    multiply(step->H, step->fx, e->hx, m, n, 1);
    combine(step->z, e->hx, -1, e->m1, m);
    multiply(e->G, e->m1, e->n1, n, m, 1);
    combine(step->fx, e->n1, 1, e->x, n);

    multiply(e->G, step->H, e->nn, n, m, n);
    from_identity(e->nn, n);
    multiply(e->nn, e->Pp, e->P, n, n, n);
    return 0;
}

int tinyekf_generic_boat(tinyekf_generic_t *ekf, double u, double rate, double dt, const double q[3], const double z[3],
                         const double r[3])
{
    tinyekf_step_t step;
    boat_step(&step, ekf->x, u, rate, dt, q, r);
    memcpy(step.z, z, sizeof step.z);
    return tinyekf_generic_step(ekf, &step);
}
