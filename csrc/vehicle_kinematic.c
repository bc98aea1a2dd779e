/* The consistent filter of the same observations. The previous epoch's position and velocity are carried beside the
 * current ones as clones, since rotations and distances compare two epochs: with the old one a constant, its error would
 * be counted as none. */
#include <math.h>

#include "angle.h"
#include "vehicle_parts.h"

enum { PX, PY, VX, VY, PX0, PY0, VX0, VY0, STATES };

/* Below this speed, in m/s, a velocity has no direction worth a rotation. */
static const double no_direction_mps = 0.05;

/* Without a rotation measured the acceleration across is this many times as free: a curve lasts, it is no white noise. */
static const double unmeasured_turn = 4.0;

/* The prediction, of both epochs. */
typedef struct {
    double x[STATES];
    double speed, azimuth;         /* now */
    double old_speed, old_azimuth; /* then */
    double length, chord_azimuth;  /* of the way between */
} prediction_t;

/* The augmented prediction: the velocity turned by what the gyros say and longer by what the accelerometer says, the way
 * halfway between. That the rotation is observed too counts it twice by next to nothing, the noise across being far wider;
 * predicting straight on instead, the tangent's correction would make the vehicle faster in every curve. Noise of the
 * acceleration along and across, constant between epochs, and a little of the position, without which the covariance
 * would be singular. What is observed is linearised at this prediction. */
static prediction_t predict(const vehicle_t *v, double acceleration, double rotation, double dt,
                            double P[STATES][STATES])
{
    const vehicle_options_t *o = &v->options;
    const double azimuth = v->pose[2];
    const double speed = v->speed_mps;
    const int measured = isfinite(acceleration);
    const double a = measured ? acceleration : 0.0;
    const double along =
        measured ? o->accel_sigma_mps2[1] * o->accel_sigma_mps2[1] : o->along_density * o->along_density / dt;
    const double turn = isfinite(rotation) ? rotation : 0.0;
    const double freedom = isfinite(rotation) ? 1.0 : unmeasured_turn;
    const double across = o->lateral_density * o->lateral_density * freedom * freedom / dt;
    const double S[2] = {0.5 * dt * dt, dt}; /* of an acceleration on position, on velocity */
    const double turning[2] = {turn / 2.0, turn};
    const double of_speed = speed > no_direction_mps ? a / speed : 0.0; /* the acceleration turns with the velocity */
    const double n[2] = {-sin(azimuth), cos(azimuth)};
    const double middle[2] = {cos(azimuth + turn / 2.0), sin(azimuth + turn / 2.0)};

    prediction_t p = {.old_speed = speed,
                      .old_azimuth = azimuth,
                      .speed = speed + a * dt,
                      .azimuth = azimuth + turn,
                      .length = speed * dt + S[0] * a,
                      .chord_azimuth = azimuth + turn / 2.0};
    double T[4][4] = {{0}};
    double Q[4][4];
    for (int block = 0; block < 2; block++) {
        const double c = cos(turning[block]);
        const double s = sin(turning[block]);
        const double R[2][2] = {{c, -s}, {s, c}};
        for (int i = 0; i < 2; i++) {
            const int row = 2 * block + i;
            for (int j = 0; j < 2; j++) {
                for (int k = 0; k < 2; k++) {
                    T[row][2 + j] += R[i][k] * ((k == j) * (block ? 1.0 : dt) + S[block] * of_speed * n[k] * n[j]);
                }
                for (int other = 0; other < 2; other++) {
                    const double across_ij = (i ? middle[0] : -middle[1]) * (j ? middle[0] : -middle[1]);
                    Q[row][2 * other + j] = S[block] * S[other] * (along * middle[i] * middle[j] + across * across_ij);
                }
            }
            if (!block) {
                T[row][row] = 1.0;
                Q[row][row] += o->position_walk * o->position_walk * dt;
            }
        }
    }
    for (int i = 0; i < 4; i++) {
        p.x[i + 4] = (double)v->ekf.x[i];
    }
    p.x[PX] = p.x[PX0] + p.length * cos(p.chord_azimuth);
    p.x[PY] = p.x[PY0] + p.length * sin(p.chord_azimuth);
    p.x[VX] = p.speed * cos(p.azimuth);
    p.x[VY] = p.speed * sin(p.azimuth);

    double TP[4][4];
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 4; j++) {
            TP[i][j] = 0.0;
            for (int k = 0; k < 4; k++) {
                TP[i][j] += T[i][k] * (double)v->ekf.P[k][j];
            }
        }
    }
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 4; j++) {
            double s = i <= j ? Q[i][j] : Q[j][i];
            for (int k = 0; k < 4; k++) {
                s += i <= j ? TP[i][k] * T[j][k] : TP[j][k] * T[i][k];
            }
            P[i][j] = s;
            P[i][j + 4] = P[j + 4][i] = TP[i][j];
            P[i + 4][j + 4] = (double)v->ekf.P[i][j];
        }
    }
    return p;
}

/* Adds an observation: h its prediction, H its derivatives there. */
static void add(vehicle_clone_measurement_t *m, int row, double z, double h, const double H[STATES], double variance)
{
    for (int i = 0; i < STATES; i++) {
        m->H[row][i] = (ekf_real)H[i];
    }
    m->z[row] = (ekf_real)z;
    m->hx[row] = (ekf_real)h;
    m->R[row][row] = (ekf_real)variance;
    m->rows |= 1u << row;
}

static void add_gps(vehicle_clone_measurement_t *m, const vehicle_t *v, const vehicle_epoch_t *epoch,
                    const prediction_t *at)
{
    const double variance = vehicle_gps_variance(&v->options, epoch);
    const double *lever = v->options.lever_m;
    const double c = cos(at->azimuth);
    const double s = sin(at->azimuth);
    const double arm[2] = {c * lever[0] - s * lever[1], s * lever[0] + c * lever[1]};
    const double by_azimuth[2] = {-arm[1], arm[0]};
    const double z[2] = {epoch->gps_x_m, epoch->gps_y_m};
    for (int i = 0; i < 2; i++) {
        double H[STATES] = {0};
        H[PX + i] = 1.0;
        if (at->speed > no_direction_mps) {
            H[VX] = by_azimuth[i] * -s / at->speed;
            H[VY] = by_azimuth[i] * c / at->speed;
        }
        add(m, VEHICLE_X + i, z[i], at->x[PX + i] + arm[i], H, variance);
    }
}

static void add_turns(vehicle_clone_measurement_t *m, const vehicle_t *v, const vehicle_epoch_t *epoch, double dt,
                      const prediction_t *at)
{
    if (!(at->speed > no_direction_mps && at->old_speed > no_direction_mps)) {
        return;
    }
    const double H[STATES] = {[VX] = -sin(at->azimuth) / at->speed,
                              [VY] = cos(at->azimuth) / at->speed,
                              [VX0] = sin(at->old_azimuth) / at->old_speed,
                              [VY0] = -cos(at->old_azimuth) / at->old_speed};
    for (int i = 0; i < 4; i++) {
        const int row = VEHICLE_PHI_ODO + i;
        const double z = epoch->turn_rad[i];
        if (isfinite(z)) {
            add(m, row, z, at->azimuth - at->old_azimuth, H, vehicle_variance(&v->options, row, z, dt));
        }
    }
}

static void add_distances(vehicle_clone_measurement_t *m, const vehicle_t *v, const vehicle_epoch_t *epoch, double dt,
                          double turn, const prediction_t *at)
{
    const double c = cos(at->chord_azimuth);
    const double s = sin(at->chord_azimuth);
    double H[STATES] = {[PX] = c, [PY] = s, [PX0] = -c, [PY0] = -s};
    const double share = vehicle_chord_share(turn);
    if (isfinite(epoch->odo_m)) {
        add(m, VEHICLE_S_ODO, epoch->odo_m * share, at->length, H,
            vehicle_variance(&v->options, VEHICLE_S_ODO, epoch->odo_m, dt));
    }
    if (isfinite(epoch->oss_m)) {
        add(m, VEHICLE_S_OSS, epoch->oss_m * share, at->length, H,
            vehicle_variance(&v->options, VEHICLE_S_OSS, epoch->oss_m, dt));
    }
    /* The accelerometer measures what the way is longer than the old velocity's; that of Bosch is in the prediction. */
    if (isfinite(epoch->xsens_mps2) && at->old_speed > no_direction_mps) {
        const double gained = 0.5 * dt * dt * epoch->xsens_mps2;
        const double sigma = 0.5 * dt * dt * v->options.accel_sigma_mps2[0];
        H[VX0] = -dt * cos(at->old_azimuth);
        H[VY0] = -dt * sin(at->old_azimuth);
        add(m, VEHICLE_S_XSENS, gained, at->length - at->old_speed * dt, H,
            sigma * sigma + vehicle_variance(&v->options, VEHICLE_S_XSENS, gained, dt));
    }
}

/* H P H' of two rows. */
static double between(const vehicle_clone_measurement_t *m, int a, int b, const double P[STATES][STATES])
{
    double s = 0.0;
    for (int i = 0; i < STATES; i++) {
        if (m->H[a][i] != 0) {
            for (int j = 0; j < STATES; j++) {
                s += (double)m->H[a][i] * P[i][j] * (double)m->H[b][j];
            }
        }
    }
    return s;
}

/* Normalised innovation squared of the position. */
static double position_nis(const vehicle_clone_measurement_t *m, const double P[STATES][STATES])
{
    const double dx = (double)(m->z[VEHICLE_X] - m->hx[VEHICLE_X]);
    const double dy = (double)(m->z[VEHICLE_Y] - m->hx[VEHICLE_Y]);
    const double xx = between(m, VEHICLE_X, VEHICLE_X, P) + (double)m->R[VEHICLE_X][VEHICLE_X];
    const double xy = between(m, VEHICLE_X, VEHICLE_Y, P);
    const double yy = between(m, VEHICLE_Y, VEHICLE_Y, P) + (double)m->R[VEHICLE_Y][VEHICLE_Y];
    return (dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy);
}

/* Takes out what lies too far from the prediction; the rows taken out. */
static uint32_t gate(vehicle_t *v, vehicle_clone_measurement_t *m, double P[STATES][STATES], double t_s)
{
    const uint32_t position = 3u << VEHICLE_X;
    uint32_t refused = 0;
    if (m->rows & position) {
        const int far = v->options.gate_gps > 0.0 && position_nis(m, (const double(*)[STATES])P) > v->options.gate_gps;
        if (far && vehicle_note_gps(v, t_s, 0)) {
            /* Refused for long enough: it is we who are lost. Both epochs, by as much as the position differs, and
             * the velocity by what would lead there. */
            const double dx = (double)(m->z[VEHICLE_X] - m->hx[VEHICLE_X]);
            const double dy = (double)(m->z[VEHICLE_Y] - m->hx[VEHICLE_Y]);
            const double lost = dx * dx + dy * dy;
            const double since = fmax(v->options.reaccept_s, 1.0);
            for (int i = 0; i < 4; i++) {
                const double variance = i < VX ? lost : lost / (since * since);
                P[i][i] += variance;
                P[i][i + PX0] += variance;
                P[i + PX0][i] += variance;
                P[i + PX0][i + PX0] += variance;
            }
            vehicle_note_gps(v, t_s, 1);
        } else if (far) {
            refused |= position;
        } else {
            vehicle_note_gps(v, t_s, 1);
        }
    }
    for (int row = VEHICLE_PHI_ODO; row < VEHICLE_ROWS; row++) {
        if (m->rows >> row & 1u && v->options.gate_row > 0.0) {
            double innovation = (double)(m->z[row] - m->hx[row]);
            if (m->angle_rows >> row & 1u) {
                innovation = angle_wrap(innovation);
            }
            const double S = between(m, row, row, (const double(*)[STATES])P) + (double)m->R[row][row];
            if (innovation * innovation > v->options.gate_row * S) {
                refused |= 1u << row;
            }
        }
    }
    m->rows &= ~refused;
    return refused;
}

void vehicle_kinematic_epoch(vehicle_t *v, const vehicle_epoch_t *epoch, double dt, vehicle_estimate_t *estimate)
{
    double turn_variance;
    const double turn = vehicle_turn(&v->options, epoch, ~0u, dt, &turn_variance);
    double P[STATES][STATES];
    const prediction_t at = predict(v, epoch->bosch_mps2, turn, dt, P);

    vehicle_clone_measurement_t m = {.rows = 0, .angle_rows = 15u << VEHICLE_PHI_ODO};
    if (vehicle_has_gps(epoch)) {
        add_gps(&m, v, epoch, &at);
    }
    add_turns(&m, v, epoch, dt, &at);
    add_distances(&m, v, epoch, dt, turn, &at);
    const uint32_t refused = gate(v, &m, P, epoch->t_s);

    vehicle_clone_t both = {.angle_states = 0};
    for (int i = 0; i < STATES; i++) {
        both.x[i] = (ekf_real)at.x[i];
        for (int j = 0; j < STATES; j++) {
            both.P[i][j] = (ekf_real)P[i][j];
        }
    }
    ekf_real nis;
    if (vehicle_clone_update(&both, &m, &nis) == EKF_ACCEPTED) {
        estimate->used = m.rows;
        estimate->chi_square = (double)nis;
        for (int row = 0; row < VEHICLE_ROWS; row++) {
            estimate->degrees += m.rows >> row & 1u;
        }
    }
    estimate->refused = refused;
    for (int i = 0; i < 4; i++) {
        v->ekf.x[i] = both.x[i];
        for (int j = 0; j < 4; j++) {
            v->ekf.P[i][j] = both.P[i][j];
        }
    }
    vehicle_pose_from_ekf(v);
}
