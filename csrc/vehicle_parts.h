/* What the methods of vehicle.h share among themselves; not for callers. */
#ifndef VEHICLE_PARTS_H
#define VEHICLE_PARTS_H

#include "vehicle.h"

/* Variance of an observation z over dt seconds. */
double vehicle_variance(const vehicle_options_t *options, int row, double z, double dt);

/* Variance of each coordinate of the epoch's GPS position. */
double vehicle_gps_variance(const vehicle_options_t *options, const vehicle_epoch_t *epoch);

int vehicle_has_gps(const vehicle_epoch_t *epoch);

/* Mean of the rotations of the observations `rows` (bits), weighted by their inverse variances, rad; *variance of it. NaN when
 * none was measured. */
double vehicle_turn(const vehicle_options_t *options, const vehicle_epoch_t *epoch, uint32_t rows, double dt,
                    double *variance);

/* The same of the distances of odometer and optical sensor, m. */
double vehicle_distance(const vehicle_options_t *options, const vehicle_epoch_t *epoch, double dt);

/* Length of the chord of an arc that turns by `turn` rad (NaN: 0), as a share of the arc. */
double vehicle_chord_share(double turn);

/* Takes the epoch into the sums of the first metres; 1 once pose, C and speed are there. */
int vehicle_find_start(vehicle_t *vehicle, const vehicle_epoch_t *epoch, double dt);

/* The filter's state and covariance from pose, C and speed; and back. */
void vehicle_ekf_from_pose(vehicle_t *vehicle);
void vehicle_pose_from_ekf(vehicle_t *vehicle);

/* Notes whether the epoch's GPS position was taken; 1 where it was refused for so long that it must be taken. */
int vehicle_note_gps(vehicle_t *vehicle, double t_s, int taken);

/* One epoch of each method, vehicle in motion. */
void vehicle_paper_epoch(vehicle_t *vehicle, const vehicle_epoch_t *epoch, double dt, vehicle_estimate_t *estimate);
void vehicle_kinematic_epoch(vehicle_t *vehicle, const vehicle_epoch_t *epoch, double dt, vehicle_estimate_t *estimate);
void vehicle_adjust_epoch(vehicle_t *vehicle, const vehicle_epoch_t *epoch, double dt, vehicle_estimate_t *estimate);

#endif
