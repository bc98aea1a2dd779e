#include "vehicle_parts.h"

#include <math.h>

#include "angle.h"

double vehicle_variance(const vehicle_options_t *options, int row, double z, double dt)
{
    const double white = options->white[row];
    const double walk = options->walk[row];
    const double relative = options->relative[row] * z;
    return white * white + walk * walk * dt + relative * relative;
}

double vehicle_gps_variance(const vehicle_options_t *options, const vehicle_epoch_t *epoch)
{
    const double sigma = epoch->gps_sigma_m;
    return isfinite(sigma) && sigma > 0.0 ? sigma * sigma : options->white[VEHICLE_X] * options->white[VEHICLE_X];
}

int vehicle_has_gps(const vehicle_epoch_t *epoch)
{
    return isfinite(epoch->gps_x_m) && isfinite(epoch->gps_y_m);
}

double vehicle_turn(const vehicle_options_t *options, const vehicle_epoch_t *epoch, uint32_t rows, double dt,
                    double *variance)
{
    double weights = 0.0;
    double sum = 0.0;
    for (int i = 0; i < 4; i++) {
        const double turn = epoch->turn_rad[i];
        if ((rows >> (VEHICLE_PHI_ODO + i) & 1u) && isfinite(turn)) {
            const double weight = 1.0 / vehicle_variance(options, VEHICLE_PHI_ODO + i, turn, dt);
            weights += weight;
            sum += weight * turn;
        }
    }
    *variance = weights > 0.0 ? 1.0 / weights : (double)NAN;
    return weights > 0.0 ? sum / weights : (double)NAN;
}

double vehicle_distance(const vehicle_options_t *options, const vehicle_epoch_t *epoch, double dt)
{
    double weights = 0.0;
    double sum = 0.0;
    if (isfinite(epoch->odo_m)) {
        weights = 1.0 / vehicle_variance(options, VEHICLE_S_ODO, epoch->odo_m, dt);
        sum = weights * epoch->odo_m;
    }
    if (isfinite(epoch->oss_m)) {
        const double weight = 1.0 / vehicle_variance(options, VEHICLE_S_OSS, epoch->oss_m, dt);
        weights += weight;
        sum += weight * epoch->oss_m;
    }
    return weights > 0.0 ? sum / weights : (double)NAN;
}

double vehicle_chord_share(double turn)
{
    return isfinite(turn) ? 1.0 - turn * turn / 24.0 : 1.0;
}

int vehicle_note_gps(vehicle_t *vehicle, double t_s, int taken)
{
    if (taken) {
        vehicle->gps_s = t_s;
        vehicle->refused_s = (double)NAN;
        return 0;
    }
    if (isnan(vehicle->refused_s)) {
        vehicle->refused_s = t_s;
    }
    return t_s - vehicle->refused_s >= vehicle->options.reaccept_s;
}

void vehicle_ekf_from_pose(vehicle_t *vehicle)
{
    const double c = cos(vehicle->pose[2]);
    const double s = sin(vehicle->pose[2]);
    const double speed = vehicle->speed_mps;
    /* Rows: the state's derivatives by x, y, azimuth and speed. */
    const double G[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, -speed * s, c}, {0, 0, speed * c, s}};
    const double x[4] = {vehicle->pose[0], vehicle->pose[1], speed * c, speed * s};
    double D[4][4] = {{0}};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            D[i][j] = vehicle->C[i][j];
        }
    }
    D[3][3] = vehicle->speed_sigma_mps * vehicle->speed_sigma_mps;
    for (int i = 0; i < 4; i++) {
        vehicle->ekf.x[i] = (ekf_real)x[i];
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k < 4; k++) {
                for (int l = 0; l < 4; l++) {
                    sum += G[i][k] * D[k][l] * G[j][l];
                }
            }
            vehicle->ekf.P[i][j] = vehicle->ekf.P[j][i] = (ekf_real)sum;
        }
    }
    vehicle->ekf.angle_states = 0;
}

void vehicle_pose_from_ekf(vehicle_t *vehicle)
{
    const double vx = (double)vehicle->ekf.x[2];
    const double vy = (double)vehicle->ekf.x[3];
    const double speed = hypot(vx, vy);
    vehicle->pose[0] = (double)vehicle->ekf.x[0];
    vehicle->pose[1] = (double)vehicle->ekf.x[1];
    vehicle->speed_mps = speed;
    if (!(speed > 1e-6)) {
        return; /* no direction: the azimuth and its covariance stay */
    }
    vehicle->pose[2] = atan2(vy, vx);
    const double c = vx / speed;
    const double s = vy / speed;
    const double J[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, -s / speed, c / speed}};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k < 4; k++) {
                for (int l = 0; l < 4; l++) {
                    sum += J[i][k] * (double)vehicle->ekf.P[k][l] * J[j][l];
                }
            }
            vehicle->C[i][j] = vehicle->C[j][i] = sum;
        }
    }
    const double xx = (double)vehicle->ekf.P[2][2];
    const double xy = (double)vehicle->ekf.P[2][3];
    const double yy = (double)vehicle->ekf.P[3][3];
    vehicle->speed_sigma_mps = sqrt(fmax(c * c * xx + 2.0 * c * s * xy + s * s * yy, 0.0));
}
