/* The start: azimuth and position from the first metres. The track dead-reckoned from azimuth 0 is turned and moved onto
 * the GPS positions by least squares, which works in a curve as well as on a straight line. */
#include <math.h>

#include "angle.h"
#include "vehicle_parts.h"

static const double given_azimuth_sigma_rad = 2.0 * ANGLE_DEGREE;
static const double first_speed_sigma_mps = 0.5;
static const double unknown_speed_sigma_mps = 5.0; /* of a chord's: the vehicle may have stood for half of it */

/* Without distances: once the positions have moved by this many sigma and metres, their chord is the azimuth. */
static const double chord_sigmas = 15.0;
static const double chord_m = 3.0;

static void turn_by(double azimuth, const double v[2], double turned[2])
{
    const double c = cos(azimuth);
    const double s = sin(azimuth);
    turned[0] = c * v[0] - s * v[1];
    turned[1] = s * v[0] + c * v[1];
}

/* Pose and covariance: the reference point at `position` less the lever arm, the azimuth's error turning about `arm`. */
static void set_pose(vehicle_t *v, const double position[2], double azimuth, double variance, double azimuth_variance,
                     const double arm[2], double speed, double speed_sigma)
{
    const double e[3] = {-arm[1], arm[0], 1.0}; /* derivative of the pose by the azimuth */
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            v->C[i][j] = azimuth_variance * e[i] * e[j] + (i == j && i < 2 ? variance : 0.0);
        }
    }
    v->pose[0] = position[0];
    v->pose[1] = position[1];
    v->pose[2] = azimuth;
    v->speed_mps = speed;
    v->speed_sigma_mps = speed_sigma;
}

static int from_given_azimuth(vehicle_t *v, const vehicle_epoch_t *epoch, double speed)
{
    const double azimuth = v->options.start_azimuth_rad;
    double lever[2];
    turn_by(azimuth, v->options.lever_m, lever);
    const double position[2] = {epoch->gps_x_m - lever[0], epoch->gps_y_m - lever[1]};
    const double arm[2] = {-lever[0], -lever[1]};
    set_pose(v, position, azimuth, vehicle_gps_variance(&v->options, epoch),
             given_azimuth_sigma_rad * given_azimuth_sigma_rad, arm, isfinite(speed) ? speed : 0.0,
             isfinite(speed) ? first_speed_sigma_mps : 10.0);
    return 1;
}

/* No distance was ever measured: the chord from the first position. */
static int from_chord(vehicle_t *v, const vehicle_epoch_t *epoch)
{
    const vehicle_start_t *start = &v->start;
    const double variance = vehicle_gps_variance(&v->options, epoch);
    const double dx = epoch->gps_x_m - start->first[0];
    const double dy = epoch->gps_y_m - start->first[1];
    const double length = hypot(dx, dy);
    const double duration = epoch->t_s - start->first[2];
    if (!(length > chord_m + chord_sigmas * sqrt(variance)) || !(duration > 0.0)) {
        return 0;
    }
    const double azimuth = atan2(dy, dx);
    double lever[2];
    turn_by(azimuth, v->options.lever_m, lever);
    const double position[2] = {epoch->gps_x_m - lever[0], epoch->gps_y_m - lever[1]};
    const double arm[2] = {0.0, 0.0};
    const double speed = length / duration;
    set_pose(v, position, azimuth, variance, 2.0 * variance / (length * length), arm, speed,
             unknown_speed_sigma_mps + speed);
    return 1;
}

/* The reckoned track turned and moved onto the positions. */
static int from_track(vehicle_t *v, double speed)
{
    const vehicle_start_t *s = &v->start;
    const double spread = s->dd - (s->d[0] * s->d[0] + s->d[1] * s->d[1]) / s->n;
    const double variance = s->variance / s->n;
    const double azimuth_variance = variance / spread;
    if (!(spread > 0.0) || !(azimuth_variance < v->options.start_sigma_rad * v->options.start_sigma_rad) ||
        s->n < 3.0) {
        return 0;
    }
    const double dot = s->dot - (s->d[0] * s->g[0] + s->d[1] * s->g[1]) / s->n;
    const double cross = s->cross - (s->d[0] * s->g[1] - s->d[1] * s->g[0]) / s->n;
    const double turn = atan2(cross, dot);
    const double from_mean[2] = {v->reckoned[0] - s->d[0] / s->n, v->reckoned[1] - s->d[1] / s->n};
    double arm[2];
    turn_by(turn, from_mean, arm);
    const double position[2] = {s->g[0] / s->n + arm[0], s->g[1] / s->n + arm[1]};
    set_pose(v, position, angle_wrap(turn + v->reckoned[2]), variance / s->n, azimuth_variance, arm,
             isfinite(speed) ? speed : 0.0, isfinite(speed) ? first_speed_sigma_mps : 10.0);
    return 1;
}

int vehicle_find_start(vehicle_t *v, const vehicle_epoch_t *epoch, double dt)
{
    vehicle_start_t *s = &v->start;
    double variance;
    const double turn = vehicle_turn(&v->options, epoch, ~0u, dt, &variance);
    const double distance = vehicle_distance(&v->options, epoch, dt);
    if (isfinite(distance)) {
        const double half = isfinite(turn) ? turn / 2.0 : 0.0;
        const double chord = distance * vehicle_chord_share(turn);
        v->reckoned[0] += chord * cos(v->reckoned[2] + half);
        v->reckoned[1] += chord * sin(v->reckoned[2] + half);
        v->reckoned[2] = angle_wrap(v->reckoned[2] + 2.0 * half);
        v->speed_mps = dt > 0.0 ? distance / dt : (double)NAN;
    }
    if (!vehicle_has_gps(epoch)) {
        return 0;
    }
    if (isfinite(v->options.start_azimuth_rad)) {
        return from_given_azimuth(v, epoch, v->speed_mps);
    }
    double lever[2];
    turn_by(v->reckoned[2], v->options.lever_m, lever);
    const double d[2] = {v->reckoned[0] + lever[0], v->reckoned[1] + lever[1]};
    const double g[2] = {epoch->gps_x_m, epoch->gps_y_m};
    if (s->n == 0.0) {
        s->first[0] = g[0];
        s->first[1] = g[1];
        s->first[2] = epoch->t_s;
    }
    s->n += 1.0;
    for (int i = 0; i < 2; i++) {
        s->g[i] += g[i];
        s->d[i] += d[i];
    }
    s->dot += d[0] * g[0] + d[1] * g[1];
    s->cross += d[0] * g[1] - d[1] * g[0];
    s->dd += d[0] * d[0] + d[1] * d[1];
    s->variance += vehicle_gps_variance(&v->options, epoch);
    return isnan(v->speed_mps) ? from_chord(v, epoch) : from_track(v, v->speed_mps);
}
