/* Declares one instance of the extended Kalman filter. Its dimensions are compile-time constants: define
 *
 *     EKF(name)   how public names are formed, e.g. ekf_##name
 *     EKF_NSTA    number of states
 *     EKF_MOBS    number of measurement rows
 *
 * include this header, and undefine the three again. ekf_template.inc, with the same three defined, is its code.
 * No include guard: every instance includes it once. The caller owns every struct; nothing is allocated. */

typedef struct {
    ekf_real x[EKF_NSTA];           /* state estimate */
    ekf_real P[EKF_NSTA][EKF_NSTA]; /* its covariance: symmetric and positive definite after every call */
    uint32_t angle_states;          /* bit i: state i is an angle in radians, kept in (-pi, pi] */
} EKF(t);

typedef struct {
    ekf_real z[EKF_MOBS];           /* measurement */
    ekf_real hx[EKF_MOBS];          /* predicted measurement h(x) */
    ekf_real H[EKF_MOBS][EKF_NSTA]; /* Jacobian of h at x */
    ekf_real R[EKF_MOBS]
              [EKF_MOBS]; /* measurement noise covariance, lower triangle; positive definite in the rows used */
    uint32_t rows;        /* bit i: row i was measured; other rows are not looked at */
    uint32_t angle_rows;  /* bit i: row i is an angle in radians: its innovation is wrapped */
    ekf_real gate;        /* largest normalised innovation squared accepted; 0: no gate */
} EKF(measurement_t);

/* Sets state, covariance and which states are angles. EKF_REFUSED, and nothing set, when a number is not finite or P0 is
 * not symmetric and positive definite. */
ekf_status_t EKF(init)(EKF(t) * ekf, const ekf_real x0[EKF_NSTA], const ekf_real P0[EKF_NSTA][EKF_NSTA],
                       uint32_t angle_states);

/* x = fx, P = F P F' + Q (the 2018 paper's (4)). fx is f(x) at the old x, F its Jacobian there; of the symmetric Q the
 * upper triangle is read. A refused or failed
 * prediction leaves the filter as it was. */
ekf_status_t EKF(predict)(EKF(t) * ekf, const ekf_real fx[EKF_NSTA], const ekf_real F[EKF_NSTA][EKF_NSTA],
                          const ekf_real Q[EKF_NSTA][EKF_NSTA]);

/* Takes a measurement ((6), (7) and the update of the paper). *nis (may be null) gets the normalised innovation squared
 * of the rows used, NaN when none was judged. Anything but EKF_ACCEPTED leaves the prediction as it was. */
ekf_status_t EKF(update)(EKF(t) * ekf, const EKF(measurement_t) * measurement, ekf_real *nis);

/* One TinyEKF step: predict with fx, F, Q, then update with z on h(x) = H fx (the mend of the 2018 paper's §3.3). */
ekf_status_t EKF(step)(EKF(t) * ekf, const ekf_real z[EKF_MOBS], const ekf_real fx[EKF_NSTA],
                       const ekf_real F[EKF_NSTA][EKF_NSTA], const ekf_real Q[EKF_NSTA][EKF_NSTA],
                       const ekf_real H[EKF_MOBS][EKF_NSTA], const ekf_real R[EKF_MOBS][EKF_MOBS]);
