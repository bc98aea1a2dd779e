/* The public functions of adaptive_ekf.h. */
#include "adaptive_ekf.h"

#include "ekf_inline.h"

#define EKF_PUBLIC

/* Thirteen states unrolled thrice over are no code that fits a cache: loops are faster there. */
#undef EKF_UNROLL
#define EKF_UNROLL

#define EKF(name) adaptive_ekf_##name
#define EKF_NSTA 13
#define EKF_MOBS 1
#include "ekf_template.inc"
#undef EKF
#undef EKF_NSTA
#undef EKF_MOBS
