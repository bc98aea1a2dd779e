/* The filter of ekf.h as inline functions, for the model that wants its constants folded into them: F and H of most models
 * are mostly zeros and ones, and the compiler, shown them, drops two thirds of the arithmetic. Anyone else: ekf.h. */
#ifndef EKF_INLINE_H
#define EKF_INLINE_H

#include <float.h>
#include <math.h>
#include <string.h>

#include "angle.h"
#include "ekf.h"

#define EKF_IS_FLOAT (sizeof(ekf_real) == sizeof(float))

/* Largest variance believed: beyond it products overflow. */
#define EKF_LARGEST ((ekf_real)(EKF_IS_FLOAT ? FLT_MAX : DBL_MAX))

#define EKF_EPSILON ((ekf_real)(EKF_IS_FLOAT ? FLT_EPSILON : DBL_EPSILON))

/* Below this share of the innovation variance, a measurement's own variance drowns in the rounding of P; in single
 * precision, every measurement's does. */
#define EKF_SMALL_SHARE ((ekf_real)(EKF_IS_FLOAT ? 2.0 : 1e-6))

/* What a sum starts from: x + -0 is x for every x, so that the compiler drops the addition (x + 0 is not, for x = -0). */
#define EKF_NOTHING ((ekf_real)-0.0)

#define EKF_ALL_ROWS ((uint32_t)((UINT64_C(1) << EKF_MOBS) - 1))

#if defined(__GNUC__)
#define EKF_INLINE static inline __attribute__((always_inline))
#else
#define EKF_INLINE static inline
#endif

/* At -O2 compilers leave loops of three turns standing; unrolled, the update takes half the time. */
#if defined(__clang__)
#define EKF_UNROLL _Pragma("unroll")
#define EKF_UNROLL_ROWS _Pragma("unroll 3")
#elif defined(__GNUC__)
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
#undef EKF
#undef EKF_NSTA
#undef EKF_MOBS

#endif
