/* The boat of the papers: state [north m, east m, heading rad], driven by surge u, sway v (m/s) and yaw rate r (rad/s). */
#ifndef HEADING_MODEL_H
#define HEADING_MODEL_H

#include "ekf.h"

enum { HEADING_NORTH = 0, HEADING_EAST = 1, HEADING_PSI = 2 };

/* Predicts over dt seconds by one Euler step of the 2018 paper's (8), F its Jacobian at the old heading; q: process
 * noise per second (m^2, m^2, rad^2), the diagonal of Q. */
ekf_status_t heading_model_predict(ekf_t *ekf, double u, double v, double r, double dt, const double q[3]);

/* Measures [north, east, heading] directly (the paper's (9)); only the rows whose bit is set. r: variances, the diagonal
 * of R. The gate as in ekf_measurement_t. */
ekf_status_t heading_model_update(ekf_t *ekf, const double z[3], uint32_t rows, const double r[3], double gate,
                                  ekf_real *nis);

#endif
