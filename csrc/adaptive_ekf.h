/* The adaptive method's instance of the extended Kalman filter: 13 states, one measurement row at a time. */
#ifndef ADAPTIVE_EKF_H
#define ADAPTIVE_EKF_H

#include "ekf.h"

#define EKF(name) adaptive_ekf_##name
#define EKF_NSTA 13
#define EKF_MOBS 1
#include "ekf_template.h"
#undef EKF
#undef EKF_NSTA
#undef EKF_MOBS

#endif
