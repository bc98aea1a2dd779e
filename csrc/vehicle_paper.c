/* The standard kinematic filter of the third paper's 2.1.1, steps 1 to 7, with its mended design matrix. It takes the
 * previous epoch for a constant, and so believes too much in itself; vehicle_kinematic.c does not. */
#include <math.h>

#include "angle.h"
#include "vehicle_parts.h"

/* Predicted distances below this, in metres, have no direction: rotations are then not looked at. */
static const double no_direction_m = 1e-3;

/* Steps 1 and 2, (9) and (10): constant velocity, the acceleration along the predicted azimuth. */
static ekf_status_t predict(vehicle_t *v, double azimuth, double acceleration, double dt)
{
    const double S[4] = {0.5 * dt * dt * cos(azimuth), 0.5 * dt * dt * sin(azimuth), dt * cos(azimuth),
                         dt * sin(azimuth)};
    ekf_real T[4][4] = {{1, 0, (ekf_real)dt, 0}, {0, 1, 0, (ekf_real)dt}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    ekf_real Q[4][4];
    ekf_real y[4];
    for (int i = 0; i < 4; i++) {
        y[i] = v->ekf.x[i] + (i < 2 ? (ekf_real)dt * v->ekf.x[i + 2] : 0) + (ekf_real)(S[i] * acceleration);
        for (int j = 0; j < 4; j++) {
            Q[i][j] = (ekf_real)(S[i] * v->options.q_ww * S[j]);
        }
    }
    return vehicle_ekf_predict(&v->ekf, y, (const ekf_real(*)[4])T, (const ekf_real(*)[4])Q);
}

static void add(vehicle_ekf_measurement_t *m, int row, double z, double predicted, double variance)
{
    m->z[row] = (ekf_real)z;
    m->hx[row] = (ekf_real)predicted;
    m->R[row][row] = (ekf_real)variance;
    m->rows |= 1u << row;
}

void vehicle_paper_epoch(vehicle_t *v, const vehicle_epoch_t *epoch, double dt, vehicle_estimate_t *estimate)
{
    const double old[2] = {(double)v->ekf.x[0], (double)v->ekf.x[1]};
    const double speed = hypot((double)v->ekf.x[2], (double)v->ekf.x[3]);
    const double azimuth = v->pose[2]; /* of the updated velocity, or the last it had */
    if (predict(v, azimuth, isfinite(epoch->bosch_mps2) ? epoch->bosch_mps2 : 0.0, dt) != EKF_ACCEPTED) {
        return;
    }
    const double dx = (double)v->ekf.x[0] - old[0];
    const double dy = (double)v->ekf.x[1] - old[1];
    const double length = hypot(dx, dy);
    const int moves = length > no_direction_m;
    const double predicted = moves ? atan2(dy, dx) : azimuth;
    const double c = cos(predicted);
    const double s = sin(predicted);

    vehicle_ekf_measurement_t m = {.rows = 0, .angle_rows = 15u << VEHICLE_PHI_ODO};
    if (vehicle_has_gps(epoch)) {
        const double variance = vehicle_gps_variance(&v->options, epoch);
        const double *lever = v->options.lever_m;
        add(&m, VEHICLE_X, epoch->gps_x_m - (c * lever[0] - s * lever[1]), (double)v->ekf.x[0], variance);
        add(&m, VEHICLE_Y, epoch->gps_y_m - (s * lever[0] + c * lever[1]), (double)v->ekf.x[1], variance);
        m.H[VEHICLE_X][0] = m.H[VEHICLE_Y][1] = 1;
        vehicle_note_gps(v, epoch->t_s, 1);
    }
    for (int i = 0; i < 4; i++) {
        const int row = VEHICLE_PHI_ODO + i;
        if (moves && isfinite(epoch->turn_rad[i])) {
            add(&m, row, epoch->turn_rad[i], angle_wrap(predicted - azimuth),
                vehicle_variance(&v->options, row, epoch->turn_rad[i], dt));
            const double h[4] = {-s / length, c / length, -dt * s / length, dt * c / length};
            for (int j = 0; j < 4; j++) {
                m.H[row][j] = (ekf_real)h[j];
            }
        }
    }
    const double by_inertia[2] = {speed * dt + 0.5 * dt * dt * epoch->xsens_mps2,
                                  speed * dt + 0.5 * dt * dt * epoch->bosch_mps2};
    const double distance[4] = {epoch->odo_m, by_inertia[0], by_inertia[1], epoch->oss_m};
    for (int i = 0; i < 4; i++) {
        const int row = VEHICLE_S_ODO + i;
        if (isfinite(distance[i])) {
            add(&m, row, distance[i], length, vehicle_variance(&v->options, row, distance[i], dt));
            const double h[4] = {c, s, dt * c, dt * s};
            for (int j = 0; j < 4; j++) {
                m.H[row][j] = (ekf_real)h[j];
            }
        }
    }
    ekf_real nis;
    if (vehicle_ekf_update(&v->ekf, &m, &nis) == EKF_ACCEPTED) {
        estimate->used = m.rows;
        estimate->chi_square = (double)nis;
        for (int row = 0; row < VEHICLE_ROWS; row++) {
            estimate->degrees += m.rows >> row & 1u;
        }
    }
    vehicle_pose_from_ekf(v);
}
