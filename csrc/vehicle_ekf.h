/* The land vehicle's instances of the extended Kalman filter: 4 states [x, y, vx, vy] with 10 measurement rows, and the
 * same with the previous epoch's four states carried beside them as clones. */
#ifndef VEHICLE_EKF_H
#define VEHICLE_EKF_H

#include "ekf.h"

#define EKF(name) vehicle_ekf_##name
#define EKF_NSTA 4
#define EKF_MOBS 10
#include "ekf_template.h"
#undef EKF
#undef EKF_NSTA
#undef EKF_MOBS

#define EKF(name) vehicle_clone_##name
#define EKF_NSTA 8
#define EKF_MOBS 10
#include "ekf_template.h"
#undef EKF
#undef EKF_NSTA
#undef EKF_MOBS

#endif
