#include "vehicle.h"

#include <math.h>
#include <string.h>

#include "angle.h"
#include "vehicle_parts.h"

static const double dead_reckoning_after_s = 1.0;
static const double departure_speed_sigma_mps = 0.3;

void vehicle_init(vehicle_t *vehicle, const vehicle_options_t *options)
{
    memset(vehicle, 0, sizeof *vehicle);
    vehicle->options = *options;
    vehicle->mode = VEHICLE_WAITING;
    vehicle->speed_mps = (double)NAN;
    vehicle->gps_s = -(double)INFINITY;
    vehicle->refused_s = (double)NAN;
}

static int is_kinematic(const vehicle_t *v)
{
    return v->options.method == VEHICLE_KINEMATIC || v->options.method == VEHICLE_KINEMATIC_PAPER;
}

/* Whether the epoch is one of a standstill. The paper's filter knows none. */
static int stands(const vehicle_t *v, const vehicle_epoch_t *epoch, double dt)
{
    const double distance = vehicle_distance(&v->options, epoch, dt);
    return v->options.method != VEHICLE_KINEMATIC_PAPER && isfinite(distance) &&
           distance < v->options.standstill_mps * dt;
}

static void move(vehicle_t *v, const vehicle_epoch_t *epoch, double dt, vehicle_estimate_t *estimate)
{
    if (stands(v, epoch, dt)) {
        v->mode = VEHICLE_STANDSTILL;
        v->speed_mps = 0.0;
        v->speed_sigma_mps = v->options.standstill_mps;
        return; /* the pose is kept: a car does not turn on the spot */
    }
    if (v->mode == VEHICLE_STANDSTILL) {
        const double distance = vehicle_distance(&v->options, epoch, dt);
        v->speed_mps = isfinite(distance) ? distance / dt : v->options.standstill_mps;
        v->speed_sigma_mps = departure_speed_sigma_mps + v->speed_mps / 2.0;
        if (is_kinematic(v)) {
            vehicle_ekf_from_pose(v);
        }
    }
    if (v->options.method == VEHICLE_KINEMATIC_PAPER) {
        vehicle_paper_epoch(v, epoch, dt, estimate);
    } else if (v->options.method == VEHICLE_KINEMATIC) {
        vehicle_kinematic_epoch(v, epoch, dt, estimate);
    } else {
        vehicle_adjust_epoch(v, epoch, dt, estimate);
    }
    v->mode = epoch->t_s - v->gps_s > dead_reckoning_after_s ? VEHICLE_DEAD_RECKONING : VEHICLE_GPS;
}

static void wait(vehicle_t *v, const vehicle_epoch_t *epoch, double dt)
{
    if (vehicle_find_start(v, epoch, dt)) {
        v->mode = VEHICLE_GPS;
        v->gps_s = epoch->t_s;
        if (is_kinematic(v)) {
            vehicle_ekf_from_pose(v);
        }
    }
}

static void report(const vehicle_t *v, vehicle_estimate_t *e)
{
    e->t_s = v->t_s;
    e->mode = v->mode;
    e->circle = v->circle;
    if (v->mode == VEHICLE_WAITING) {
        double *missing[] = {&e->x_m,         &e->y_m,       &e->vx_mps,         &e->vy_mps,
                             &e->azimuth_rad, &e->speed_mps, &e->speed_sigma_mps};
        for (unsigned i = 0; i < sizeof missing / sizeof *missing; i++) {
            *missing[i] = (double)NAN;
        }
        for (int i = 0; i < 6; i++) {
            e->covariance[i] = (double)NAN;
        }
        return;
    }
    e->x_m = v->pose[0];
    e->y_m = v->pose[1];
    e->azimuth_rad = angle_wrap_positive(v->pose[2]);
    e->speed_mps = v->speed_mps;
    e->speed_sigma_mps = v->speed_sigma_mps;
    e->vx_mps = v->speed_mps * cos(v->pose[2]);
    e->vy_mps = v->speed_mps * sin(v->pose[2]);
    int k = 0;
    for (int i = 0; i < 3; i++) {
        for (int j = i; j < 3; j++) {
            e->covariance[k++] = v->C[i][j];
        }
    }
}

void vehicle_run(vehicle_t *v, const vehicle_epoch_t *epochs, vehicle_estimate_t *estimates, int n)
{
    for (int i = 0; i < n; i++) {
        const vehicle_epoch_t *epoch = &epochs[i];
        vehicle_estimate_t *estimate = &estimates[i];
        memset(estimate, 0, sizeof *estimate);
        estimate->chi_square = estimate->worst_w = estimate->worst_row = (double)NAN;
        const double dt = v->started ? epoch->t_s - v->t_s : 0.0;
        if (dt > 0.0 || !v->started) {
            v->t_s = epoch->t_s;
            v->started = 1;
            if (v->mode == VEHICLE_WAITING) {
                wait(v, epoch, dt);
            } else {
                move(v, epoch, dt, estimate);
            }
        }
        report(v, estimate);
    }
}
