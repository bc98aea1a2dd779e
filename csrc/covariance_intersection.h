/* Covariance intersection of two estimates whose correlation is unknown (design of the 2015 predecessor, EKF-CI). */
#ifndef COVARIANCE_INTERSECTION_H
#define COVARIANCE_INTERSECTION_H

#include "ekf.h"

typedef enum { CI_MINIMISE_DET = 0, CI_MINIMISE_TRACE = 1 } ci_objective_t;

/* out = the intersection: C^-1 = w A^-1 + (1-w) B^-1, c = C (w A^-1 a + (1-w) B^-1 b), with w in [0, 1] minimising
 * log det C or trace C. b's angle states (a's mask) are first moved next to a's. *omega (may be null) gets w. Fails,
 * with out untouched, when A or B is not positive definite. out may be a or b. */
ekf_status_t covariance_intersection(const ekf_t *a, const ekf_t *b, ci_objective_t objective, ekf_t *out,
                                     double *omega);

#endif
