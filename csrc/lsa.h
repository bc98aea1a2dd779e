/* Least-squares adjustment as a geodesist expects it: Gauss-Newton to convergence over observations with a full cofactor
 * matrix, then residuals, cofactors, redundancy numbers, the global test and Baarda's w-test. Small and static. */
#ifndef LSA_H
#define LSA_H

#ifndef TINYEKF_CDEF
#include <stdint.h>
#endif

#define LSA_MAX_OBSERVATIONS 10
#define LSA_MAX_UNKNOWNS 6
#define LSA_MAX_ITERATIONS 20

typedef enum {
    LSA_CONVERGED = 0,
    LSA_DIVERGED = 1, /* no convergence within LSA_MAX_ITERATIONS */
    LSA_SINGULAR = 2, /* the observations do not determine the unknowns, or their cofactors are no covariance */
    LSA_REFUSED = 3   /* NaN or infinity among the observations or first values */
} lsa_status_t;

/* Observations l with cofactor matrix Q (symmetric, of variance factor 1). */
typedef struct {
    int n_observations; /* 1 to LSA_MAX_OBSERVATIONS */
    int n_unknowns;     /* 1 to LSA_MAX_UNKNOWNS, not more than observations */
    double l[LSA_MAX_OBSERVATIONS];
    double Q[LSA_MAX_OBSERVATIONS][LSA_MAX_OBSERVATIONS];
    uint32_t angle_rows; /* bit i: observation i is an angle in radians: its misclosure is wrapped */
} lsa_observations_t;

/* The functional model: observations h and design matrix A at the unknowns x. */
typedef void (*lsa_model_t)(const double x[LSA_MAX_UNKNOWNS], double h[LSA_MAX_OBSERVATIONS],
                            double A[LSA_MAX_OBSERVATIONS][LSA_MAX_UNKNOWNS], const void *context);

typedef struct {
    double x[LSA_MAX_UNKNOWNS];                                    /* adjusted unknowns; in: their first values */
    double Qxx[LSA_MAX_UNKNOWNS][LSA_MAX_UNKNOWNS];                /* their cofactors */
    double v[LSA_MAX_OBSERVATIONS];                                /* residuals h(x) - l */
    double l_adjusted[LSA_MAX_OBSERVATIONS];                       /* l + v */
    double Q_adjusted[LSA_MAX_OBSERVATIONS][LSA_MAX_OBSERVATIONS]; /* cofactors of the adjusted observations */
    double Qvv[LSA_MAX_OBSERVATIONS][LSA_MAX_OBSERVATIONS];        /* cofactors of the residuals, Q - Q_adjusted */
    double redundancy[LSA_MAX_OBSERVATIONS];                       /* share of an observation's error that v shows */
    double w[LSA_MAX_OBSERVATIONS]; /* Baarda's test value, standard normal; NaN where the redundancy is next to 0 */
    double vPv;                     /* sum of squares, chi-square of `degrees` */
    int degrees;                    /* observations less unknowns */
    int iterations;
} lsa_result_t;

/* Adjusts: result->x holds the first values and gets the adjusted unknowns. Only with LSA_CONVERGED is the rest set. */
lsa_status_t lsa_adjust(const lsa_observations_t *observations, lsa_model_t model, const void *context,
                        lsa_result_t *result);

/* Largest chi-square of the global test at 0.1 % error of the first kind, for 1 to LSA_MAX_OBSERVATIONS degrees of
 * freedom; infinite for 0. */
double lsa_critical_chi_square(int degrees);

/* Largest |w| at the same 0.1 %. */
#define LSA_CRITICAL_W 3.2905267314918945

#endif
