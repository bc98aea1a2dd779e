/* Position and azimuth of a land vehicle from GPS, odometer, optical speed sensor and gyros (the third paper), epoch by
 * epoch. x north, y east in metres, azimuths clockwise from north in radians; NaN is missing. docs/vehicle.md says exactly
 * what is computed. */
#ifndef VEHICLE_H
#define VEHICLE_H

#ifndef TINYEKF_CDEF
#include <stdint.h>
#endif

#include "vehicle_ekf.h"

#define VEHICLE_ROWS 10

/* The observations in the order of the paper's (4). */
enum {
    VEHICLE_X = 0,
    VEHICLE_Y = 1,
    VEHICLE_PHI_ODO = 2,
    VEHICLE_PHI_XSENS = 3,
    VEHICLE_PHI_SILICON = 4,
    VEHICLE_PHI_BOSCH = 5,
    VEHICLE_S_ODO = 6,
    VEHICLE_S_XSENS = 7,
    VEHICLE_S_BOSCH = 8,
    VEHICLE_S_OSS = 9
};

typedef enum {
    VEHICLE_KINEMATIC_PAPER = 0, /* 2.1.1 as printed, its damaged matrix mended */
    VEHICLE_KINEMATIC = 1,       /* the consistent filter of the same observations */
    VEHICLE_LSA_STRAIGHT = 2,    /* 2.1.2 */
    VEHICLE_LSA_CIRCLE = 3,      /* 2.1.3 */
    VEHICLE_LSA = 4              /* switches between the two */
} vehicle_method_t;

/* What was measured at an epoch, and since the one before. */
typedef struct {
    double t_s;
    double gps_x_m;
    double gps_y_m;
    double gps_sigma_m; /* of each coordinate; NaN: that of the options */
    double turn_rad[4]; /* odometer, XSENS, Silicon, Bosch */
    double odo_m;       /* distance of the odometer */
    double xsens_mps2;  /* mean longitudinal acceleration */
    double bosch_mps2;
    double oss_m; /* distance of the optical sensor */
} vehicle_epoch_t;

typedef enum {
    VEHICLE_WAITING = 0, /* for a position and an azimuth to start from */
    VEHICLE_GPS = 1,
    VEHICLE_DEAD_RECKONING = 2, /* no GPS position taken for 1 s */
    VEHICLE_STANDSTILL = 3
} vehicle_mode_t;

/* All numbers doubles, so that an array of them is one table. */
typedef struct {
    double t_s;
    double x_m;
    double y_m;
    double vx_mps;
    double vy_mps;
    double azimuth_rad; /* [0, 2 pi) */
    double speed_mps;
    double covariance[6]; /* of x, y, azimuth: xx, xy, xa, yy, ya, aa */
    double speed_sigma_mps;
    double mode;       /* vehicle_mode_t */
    double used;       /* bit i: observation i was used */
    double refused;    /* bit i: observation i was refused */
    double chi_square; /* global test: v'Pv of the adjustment, normalised innovation squared of a filter */
    double degrees;    /* its degrees of freedom */
    double worst_w;    /* largest |w| of the adjustment */
    double worst_row;  /* its observation; NaN: none could be tested */
    double circle;     /* 1 where the circle's adjustment was used */
} vehicle_estimate_t;

typedef struct {
    int method;
    /* Standard deviation of observation i: sqrt(white^2 + walk^2 dt + (relative z)^2), dt in s. */
    double white[VEHICLE_ROWS];    /* m, rad */
    double walk[VEHICLE_ROWS];     /* m/sqrt(s), rad/sqrt(s) */
    double relative[VEHICLE_ROWS]; /* 1 */
    double accel_sigma_mps2[2];    /* of the accelerations of XSENS and Bosch */
    double q_ww;                   /* the paper's variance of the acceleration, (m/s^2)^2 */
    double along_density;          /* acceleration along, where none is measured, m/s^2/sqrt(Hz) */
    double lateral_density;        /* acceleration across, m/s^2/sqrt(Hz) */
    double position_walk;          /* m/sqrt(s): slip, and what the model leaves out */
    double gate_gps;               /* largest normalised innovation squared, 2 degrees of freedom; 0: no gate */
    double gate_row;               /* the same of a single observation */
    double reaccept_s;             /* refused for so long, a GPS position is taken all the same */
    double standstill_mps;         /* below it the vehicle stands */
    double start_sigma_rad;        /* azimuth good enough to start from */
    double start_azimuth_rad;      /* NaN: found from the first metres */
    double lever_m[2];             /* GPS antenna: forward and to starboard of the reference point */
    double turn_threshold_rad;     /* rotation of an epoch above which the drive is a circle */
    double turn_hysteresis;        /* share of the threshold below which it is straight again */
} vehicle_options_t;

/* Sums of the first metres, from which the start is found. */
typedef struct {
    double n;
    double g[2], d[2];     /* positions of the antenna: by GPS, by dead reckoning */
    double dot, cross, dd; /* sums of d.g, d x g, d.d */
    double variance;       /* sum of the GPS variances */
    double first[3];       /* first GPS position and its time */
} vehicle_start_t;

typedef struct {
    vehicle_options_t options;
    int mode;
    int started; /* an epoch was taken */
    int circle;
    double t_s;
    vehicle_ekf_t ekf; /* of the kinematic methods */
    double pose[3];    /* x, y, azimuth: of the adjustment, and of a start or a standstill of any method */
    double C[3][3];    /* their covariance */
    double speed_mps;
    double speed_sigma_mps;
    double gps_s;     /* time of the last GPS position taken */
    double refused_s; /* since when GPS positions are refused; NaN: they are not */
    vehicle_start_t start;
    double reckoned[3]; /* dead-reckoned x, y, azimuth since the beginning, while waiting */
} vehicle_t;

/* Forgets everything and takes options. */
void vehicle_init(vehicle_t *vehicle, const vehicle_options_t *options);

/* Takes n epochs in order of time and writes as many estimates. An epoch that is not later than the last gives the last
 * estimate's state again, untouched. */
void vehicle_run(vehicle_t *vehicle, const vehicle_epoch_t *epochs, vehicle_estimate_t *estimates, int n);

#endif
