/* The public functions of vehicle_ekf.h. */
#include "vehicle_ekf.h"

#include "ekf_inline.h"

#define EKF_PUBLIC

#define EKF(name) vehicle_ekf_##name
#define EKF_NSTA 4
#define EKF_MOBS 10
#include "ekf_template.inc"
#undef EKF
#undef EKF_NSTA
#undef EKF_MOBS

/* Eight states unrolled thrice over are 512 lines a product: loops are faster there. */
#undef EKF_UNROLL
#define EKF_UNROLL

#define EKF(name) vehicle_clone_##name
#define EKF_NSTA 8
#define EKF_MOBS 10
#include "ekf_template.inc"
#undef EKF
#undef EKF_NSTA
#undef EKF_MOBS
