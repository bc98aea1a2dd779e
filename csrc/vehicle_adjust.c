/* Least-squares adjustment of one epoch: the third paper's straight line (2.1.2) and circle (2.1.3). Unknown are the
 * positions and azimuths of both epochs; one azimuth follows from the others. Straight: the chord's azimuth is that of the
 * previous epoch, and the rotation comes at its end. Circle: the chord's azimuth is the mean of both. */
#include <math.h>

#include "angle.h"
#include "lsa.h"
#include "vehicle_parts.h"

enum { X0, Y0, X1 = 2, Y1 = 3, FREE_AZIMUTH = 4, UNKNOWNS = 5 };
enum { GYROS = VEHICLE_ROWS, INERTIA, OLD_X, OLD_Y, OLD_AZIMUTH };
enum { MAX_SNOOPED = 3 };

/* What stands in for a rotation or a distance that no sensor measured. */
static const double free_turn_rad_per_s = 0.3;
static const double free_acceleration_mps2 = 4.0;

static const uint32_t gyro_rows = 1u << VEHICLE_PHI_XSENS | 1u << VEHICLE_PHI_SILICON | 1u << VEHICLE_PHI_BOSCH;

/* The observations in hand, and what the model needs to know. */
typedef struct {
    int circle;
    double lever[2];
    int row[LSA_MAX_OBSERVATIONS];       /* VEHICLE_X ..., or one of those above */
    uint32_t bits[LSA_MAX_OBSERVATIONS]; /* the sensors' observations behind it */
    lsa_observations_t o;
} epoch_observations_t;

/* A number and its derivatives by the five unknowns. */
typedef struct {
    double value;
    double by[UNKNOWNS];
} dependent_t;

typedef struct {
    dependent_t length, old_azimuth, azimuth;
} geometry_t;

static geometry_t geometry(const double x[UNKNOWNS], int circle)
{
    const double dx = x[X1] - x[X0];
    const double dy = x[Y1] - x[Y0];
    const double D = hypot(dx, dy);
    const double c = dx / D;
    const double s = dy / D;
    const dependent_t chord = {atan2(dy, dx), {s / D, -c / D, -s / D, c / D, 0}};
    const dependent_t given = {x[FREE_AZIMUTH], {0, 0, 0, 0, 1}};
    geometry_t g = {.length = {D, {-c, -s, c, s, 0}}, .old_azimuth = given, .azimuth = given};
    if (circle) {
        g.azimuth.value = given.value + 2.0 * angle_wrap(chord.value - given.value);
        for (int i = 0; i < UNKNOWNS; i++) {
            g.azimuth.by[i] = 2.0 * chord.by[i] - given.by[i];
        }
    } else {
        g.old_azimuth = chord;
    }
    return g;
}

static void model(const double x[LSA_MAX_UNKNOWNS], double h[LSA_MAX_OBSERVATIONS],
                  double A[LSA_MAX_OBSERVATIONS][LSA_MAX_UNKNOWNS], const void *context)
{
    const epoch_observations_t *e = context;
    const geometry_t g = geometry(x, e->circle);
    const double c = cos(g.azimuth.value);
    const double s = sin(g.azimuth.value);
    const double arm[2] = {c * e->lever[0] - s * e->lever[1], s * e->lever[0] + c * e->lever[1]};
    for (int k = 0; k < e->o.n_observations; k++) {
        const int row = e->row[k];
        dependent_t value = g.length;
        if (row == VEHICLE_X || row == VEHICLE_Y) {
            const int y = row == VEHICLE_Y;
            value.value = x[X1 + y] + arm[y];
            for (int i = 0; i < UNKNOWNS; i++) {
                value.by[i] = (i == X1 + y) + (y ? arm[0] : -arm[1]) * g.azimuth.by[i];
            }
        } else if (row == GYROS || row == VEHICLE_PHI_ODO) {
            value.value = g.azimuth.value - g.old_azimuth.value;
            for (int i = 0; i < UNKNOWNS; i++) {
                value.by[i] = g.azimuth.by[i] - g.old_azimuth.by[i];
            }
        } else if (row == OLD_AZIMUTH) {
            value = g.old_azimuth;
        } else if (row == OLD_X || row == OLD_Y) {
            value = (dependent_t){x[row - OLD_X], {row == OLD_X, row == OLD_Y, 0, 0, 0}};
        }
        h[k] = value.value;
        for (int i = 0; i < UNKNOWNS; i++) {
            A[k][i] = value.by[i];
        }
    }
}

static void add(epoch_observations_t *e, int row, uint32_t bits, double l, double variance)
{
    const int k = e->o.n_observations++;
    e->row[k] = row;
    e->bits[k] = bits;
    e->o.l[k] = l;
    e->o.Q[k][k] = variance;
    if (row == GYROS || row == VEHICLE_PHI_ODO || row == OLD_AZIMUTH) {
        e->o.angle_rows |= 1u << k;
    }
}

static uint32_t measured_turns(const vehicle_epoch_t *epoch)
{
    uint32_t bits = 0;
    for (int i = 0; i < 4; i++) {
        bits |= isfinite(epoch->turn_rad[i]) ? 1u << (VEHICLE_PHI_ODO + i) : 0u;
    }
    return bits;
}

/* Distance by inertia: the old speed and the acceleration of Bosch, else of XSENS. */
static void add_inertia(epoch_observations_t *e, const vehicle_t *v, const vehicle_epoch_t *epoch, double dt,
                        uint32_t left_out, int needed)
{
    const int of_bosch = isfinite(epoch->bosch_mps2) && !(left_out >> VEHICLE_S_BOSCH & 1u);
    const int row = of_bosch ? VEHICLE_S_BOSCH : VEHICLE_S_XSENS;
    const double a = of_bosch ? epoch->bosch_mps2 : epoch->xsens_mps2;
    const int measured = isfinite(a) && !(left_out >> row & 1u);
    if (!measured && !needed) {
        return;
    }
    const double sigma = measured ? v->options.accel_sigma_mps2[of_bosch] : free_acceleration_mps2;
    const double by_speed = v->speed_sigma_mps * dt;
    const double by_acceleration = 0.5 * dt * dt * sigma;
    const double l = v->speed_mps * dt + (measured ? 0.5 * dt * dt * a : 0.0);
    add(e, INERTIA, measured ? 1u << row : 0u, l,
        by_speed * by_speed + by_acceleration * by_acceleration + vehicle_variance(&v->options, row, l, dt));
}

static epoch_observations_t observe(const vehicle_t *v, const vehicle_epoch_t *epoch, double dt, int circle,
                                    uint32_t left_out)
{
    epoch_observations_t e = {.circle = circle, .lever = {v->options.lever_m[0], v->options.lever_m[1]}};
    double variance;
    if (vehicle_has_gps(epoch) && !(left_out >> VEHICLE_X & 1u)) {
        variance = vehicle_gps_variance(&v->options, epoch);
        add(&e, VEHICLE_X, 3u, epoch->gps_x_m, variance);
        add(&e, VEHICLE_Y, 3u, epoch->gps_y_m, variance);
    }
    const uint32_t turns = measured_turns(epoch) & ~left_out;
    const double turn = vehicle_turn(&v->options, epoch, turns, dt, &variance);
    const double gyros = vehicle_turn(&v->options, epoch, turns & gyro_rows, dt, &variance);
    if (isfinite(gyros)) {
        add(&e, GYROS, turns & gyro_rows, gyros, variance);
    }
    if (turns >> VEHICLE_PHI_ODO & 1u) {
        const double z = epoch->turn_rad[0];
        add(&e, VEHICLE_PHI_ODO, 1u << VEHICLE_PHI_ODO, z, vehicle_variance(&v->options, VEHICLE_PHI_ODO, z, dt));
    } else if (!turns) {
        const double sigma = free_turn_rad_per_s * dt;
        add(&e, GYROS, 0, 0.0, sigma * sigma);
    }
    const double share = vehicle_chord_share(turn);
    const int odo = isfinite(epoch->odo_m) && !(left_out >> VEHICLE_S_ODO & 1u);
    const int oss = isfinite(epoch->oss_m) && !(left_out >> VEHICLE_S_OSS & 1u);
    if (odo) {
        add(&e, VEHICLE_S_ODO, 1u << VEHICLE_S_ODO, epoch->odo_m * share,
            vehicle_variance(&v->options, VEHICLE_S_ODO, epoch->odo_m, dt));
    }
    if (oss) {
        add(&e, VEHICLE_S_OSS, 1u << VEHICLE_S_OSS, epoch->oss_m * share,
            vehicle_variance(&v->options, VEHICLE_S_OSS, epoch->oss_m, dt));
    }
    add_inertia(&e, v, epoch, dt, left_out, !odo && !oss);
    const int first = e.o.n_observations;
    for (int i = 0; i < 3; i++) {
        add(&e, OLD_X + i, 0, v->pose[i], v->C[i][i]);
        for (int j = 0; j < i; j++) {
            e.o.Q[first + i][first + j] = e.o.Q[first + j][first + i] = v->C[i][j];
        }
    }
    e.o.n_unknowns = UNKNOWNS;
    return e;
}

/* First values: dead reckoning from the old pose; on the circle by the odometer's rotation, where there is one. */
static void approximate(const vehicle_t *v, const vehicle_epoch_t *epoch, double dt, int circle, double x[UNKNOWNS])
{
    double variance;
    double turn = vehicle_turn(&v->options, epoch, 1u << VEHICLE_PHI_ODO, dt, &variance);
    if (!isfinite(turn)) {
        turn = vehicle_turn(&v->options, epoch, ~0u, dt, &variance);
    }
    turn = isfinite(turn) ? turn : 0.0;
    double length = vehicle_distance(&v->options, epoch, dt);
    length = isfinite(length) ? length : v->speed_mps * dt;
    length = length > 1e-3 ? length : 1e-3;
    const double chord = v->pose[2] + (circle ? turn / 2.0 : 0.0);
    x[X0] = v->pose[0];
    x[Y0] = v->pose[1];
    x[X1] = v->pose[0] + length * cos(chord);
    x[Y1] = v->pose[1] + length * sin(chord);
    x[FREE_AZIMUTH] = v->pose[2] + (circle ? 0.0 : turn);
}

/* The sensors' observation with the largest |w|; -1 where none was tested. The previous epoch is not suspected: it fails
 * whenever a position does, by the same. */
static int worst(const epoch_observations_t *e, const lsa_result_t *r)
{
    int found = -1;
    for (int k = 0; k < e->o.n_observations; k++) {
        if (e->bits[k] && isfinite(r->w[k]) && (found < 0 || fabs(r->w[k]) > fabs(r->w[found]))) {
            found = k;
        }
    }
    return found;
}

/* Whether the rotation since the last epoch makes the drive a circle, by Bosch, Silicon and odometer. */
static int is_circle(const vehicle_t *v, const vehicle_epoch_t *epoch, double dt)
{
    const uint32_t judges = 1u << VEHICLE_PHI_ODO | 1u << VEHICLE_PHI_SILICON | 1u << VEHICLE_PHI_BOSCH;
    double variance;
    double turn = vehicle_turn(&v->options, epoch, judges, dt, &variance);
    if (!isfinite(turn)) {
        turn = vehicle_turn(&v->options, epoch, ~0u, dt, &variance);
    }
    if (v->options.method != VEHICLE_LSA) {
        return v->options.method == VEHICLE_LSA_CIRCLE;
    }
    if (!isfinite(turn)) {
        return v->circle;
    }
    const double threshold = v->options.turn_threshold_rad * (v->circle ? v->options.turn_hysteresis : 1.0);
    return fabs(turn) > threshold;
}

/* The current epoch's unknowns become the old ones of the next. */
static void keep(vehicle_t *v, const lsa_result_t *r, double acceleration, double dt)
{
    const geometry_t g = geometry(r->x, v->circle);
    const dependent_t now[3] = {{r->x[X1], {[X1] = 1}}, {r->x[Y1], {[Y1] = 1}}, g.azimuth};
    double speed_variance = 0.0;
    for (int i = 0; i < UNKNOWNS; i++) {
        for (int j = 0; j < UNKNOWNS; j++) {
            speed_variance += g.length.by[i] * r->Qxx[i][j] * g.length.by[j];
        }
    }
    for (int a = 0; a < 3; a++) {
        for (int b = 0; b <= a; b++) {
            double s = 0.0;
            for (int i = 0; i < UNKNOWNS; i++) {
                for (int j = 0; j < UNKNOWNS; j++) {
                    s += now[a].by[i] * r->Qxx[i][j] * now[b].by[j];
                }
            }
            v->C[a][b] = v->C[b][a] = s;
        }
    }
    for (int a = 0; a < 3; a++) {
        v->pose[a] = now[a].value;
    }
    v->pose[2] = angle_wrap(v->pose[2]);
    v->speed_mps = g.length.value / dt + (isfinite(acceleration) ? 0.5 * dt * acceleration : 0.0); /* at its end */
    v->speed_sigma_mps = sqrt(fmax(speed_variance, 0.0)) / dt;
}

/* Counts a position's refusal; refused for long enough, the old position is what is wrong. */
static int must_take_gps(vehicle_t *v, const vehicle_epoch_t *epoch)
{
    if (!vehicle_note_gps(v, epoch->t_s, 0)) {
        return 0;
    }
    const double dx = epoch->gps_x_m - v->pose[0];
    const double dy = epoch->gps_y_m - v->pose[1];
    const double lost = dx * dx + dy * dy;
    const double way = v->speed_mps * fmax(v->options.reaccept_s, 1.0);
    v->C[0][0] += lost;
    v->C[1][1] += lost;
    v->C[2][2] += lost / (lost + way * way); /* the azimuth by what would lead there */
    return 1;
}

void vehicle_adjust_epoch(vehicle_t *v, const vehicle_epoch_t *epoch, double dt, vehicle_estimate_t *estimate)
{
    v->circle = is_circle(v, epoch, dt);
    uint32_t refused = 0;
    for (int snooped = 0;; snooped++) {
        const epoch_observations_t e = observe(v, epoch, dt, v->circle, refused);
        lsa_result_t r;
        approximate(v, epoch, dt, v->circle, r.x);
        if (lsa_adjust(&e.o, model, &e, &r) != LSA_CONVERGED) {
            return;
        }
        const int suspect = worst(&e, &r);
        const int outlier =
            suspect >= 0 && r.vPv > lsa_critical_chi_square(r.degrees) && fabs(r.w[suspect]) > LSA_CRITICAL_W;
        if (outlier && snooped < MAX_SNOOPED) {
            if (e.row[suspect] > VEHICLE_Y || !must_take_gps(v, epoch)) {
                refused |= e.bits[suspect];
            }
            continue;
        }
        keep(v, &r, isfinite(epoch->bosch_mps2) ? epoch->bosch_mps2 : epoch->xsens_mps2, dt);
        for (int k = 0; k < e.o.n_observations; k++) {
            estimate->used = (double)((uint32_t)estimate->used | e.bits[k]);
        }
        if ((uint32_t)estimate->used & 1u) {
            vehicle_note_gps(v, epoch->t_s, 1);
        }
        estimate->refused = refused;
        estimate->chi_square = r.vPv;
        estimate->degrees = r.degrees;
        if (suspect >= 0) {
            estimate->worst_w = fabs(r.w[suspect]);
            for (int row = VEHICLE_ROWS - 1; row >= 0; row--) {
                if (e.bits[suspect] >> row & 1u) {
                    estimate->worst_row = e.row[suspect] < VEHICLE_ROWS ? e.row[suspect] : row;
                }
            }
        }
        return;
    }
}
