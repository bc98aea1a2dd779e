/* The extended Kalman filter, statically sized. ekf_template.h says what its functions do; this is the instance of the
 * heading filters: 3 states, 3 measurement rows. Another instance (other dimensions) is these few lines again. */
#ifndef EKF_H
#define EKF_H

#ifndef TINYEKF_CDEF
#include <stdint.h>
#endif

#ifndef EKF_REAL
#define EKF_REAL double /* build option: -DEKF_REAL=float */
#endif
typedef EKF_REAL ekf_real;

/* What a call did. Everything but EKF_ACCEPTED left the filter as it was. */
typedef enum {
    EKF_ACCEPTED = 0,
    EKF_GATED = 1,   /* normalised innovation squared above the gate */
    EKF_SKIPPED = 2, /* nothing measured */
    EKF_FAILED = 3,  /* the result would not be positive definite */
    EKF_REFUSED = 4  /* NaN or infinity among the arguments */
} ekf_status_t;

#define EKF(name) ekf_##name
#define EKF_NSTA 3
#define EKF_MOBS 3
#include "ekf_template.h"
#undef EKF
#undef EKF_NSTA
#undef EKF_MOBS

#endif
