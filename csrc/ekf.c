#include "ekf.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "angle.h"

/* Largest variance believed: beyond it products overflow. */
#define EKF_LARGEST ((ekf_real)(sizeof(ekf_real) == sizeof(float) ? FLT_MAX : DBL_MAX))

/* Below this share of the innovation variance, a measurement's own variance is lost to cancellation in P. */
#define EKF_SMALL_SHARE ((ekf_real)(sizeof(ekf_real) == sizeof(float) ? 2.0 : 1e-6))

/* GCC at -O2 leaves loops of three turns standing; unrolled, the update takes half the time. */
#if defined(__GNUC__) && !defined(__clang__)
#define EKF_UNROLL _Pragma("GCC unroll 9")
#define EKF_UNROLL_ROWS _Pragma("GCC unroll 3")
#else
#define EKF_UNROLL
#define EKF_UNROLL_ROWS
#endif

#define EKF(name) ekf_##name
#define EKF_NSTA 3
#define EKF_MOBS 3
#include "ekf_template.inc"
