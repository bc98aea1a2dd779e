#include "heading_model.h"

#include <math.h>

ekf_status_t heading_model_predict(ekf_t *ekf, double u, double v, double r, double dt, const double q[3])
{
    const double psi = (double)ekf->x[HEADING_PSI];
    const double c = cos(psi);
    const double s = sin(psi);
    const double north = dt * (u * c - v * s);
    const double east = dt * (u * s + v * c);
    const ekf_real fx[3] = {
        (ekf_real)((double)ekf->x[HEADING_NORTH] + north),
        (ekf_real)((double)ekf->x[HEADING_EAST] + east),
        (ekf_real)(psi + dt * r),
    };
    const ekf_real F[3][3] = {{1, 0, (ekf_real)-east}, {0, 1, (ekf_real)north}, {0, 0, 1}};
    const ekf_real Q[3][3] = {
        {(ekf_real)(q[0] * dt), 0, 0},
        {0, (ekf_real)(q[1] * dt), 0},
        {0, 0, (ekf_real)(q[2] * dt)},
    };
    return ekf_predict(ekf, fx, F, Q);
}

ekf_status_t heading_model_update(ekf_t *ekf, const double z[3], uint32_t rows, const double r[3], double gate,
                                  ekf_real *nis)
{
    ekf_measurement_t m = {
        .H = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
        .rows = rows,
        .angle_rows = 1u << HEADING_PSI,
        .gate = (ekf_real)gate,
    };
    for (int i = 0; i < 3; i++) {
        m.z[i] = (ekf_real)z[i];
        m.hx[i] = ekf->x[i];
        m.R[i][i] = (ekf_real)r[i];
    }
    return ekf_update(ekf, &m, nis);
}
