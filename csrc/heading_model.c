#include "heading_model.h"

#include <math.h>

#include "ekf_inline.h"

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
    return ekf_predict_inline(ekf, fx, F, Q);
}

ekf_status_t heading_model_update(ekf_t *ekf, const double z[3], uint32_t rows, const double r[3], double gate,
                                  ekf_real *nis)
{
    ekf_measurement_t m; /* entry by entry: clearing it all first would take longer than the update */
    m.rows = rows;
    m.angle_rows = 1u << HEADING_PSI;
    m.gate = (ekf_real)gate;
    EKF_UNROLL
    for (int i = 0; i < 3; i++) {
        m.z[i] = (ekf_real)z[i];
        m.hx[i] = ekf->x[i];
        EKF_UNROLL
        for (int j = 0; j < 3; j++) {
            m.H[i][j] = i == j;
            m.R[i][j] = i == j ? (ekf_real)r[i] : 0;
        }
    }
    return ekf_update_inline(ekf, &m, nis);
}
