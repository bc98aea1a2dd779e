/* What the adaptive method believes of the boat, as a filter: where she points, what her gyro and compass do wrong, and how
 * she and the water move. Heading is carried as its difference from the gyro's integrated yaw (yaw_history.h), so that the
 * state changes slowly however she turns. docs/adaptive.md says it in words. */
#ifndef ADAPTIVE_MODEL_H
#define ADAPTIVE_MODEL_H

#include "adaptive_ekf.h"

enum {
    ADAPTIVE_OFFSET = 0,    /* rad: heading minus the gyro's integrated yaw */
    ADAPTIVE_BIAS = 1,      /* rad/s: of the gyro; without one, minus the rate of turn */
    ADAPTIVE_GAIN = 2,      /* of the gyro, minus 1 */
    ADAPTIVE_DEVIATION = 3, /* rad, 5 states: A to E, on top of the configured table */
    ADAPTIVE_LAG = 8,       /* s: of the compass */
    ADAPTIVE_SPEED = 9,     /* m/s: ahead through the water */
    ADAPTIVE_SLIP = 10,     /* m: sideways speed of the point of pivot per rate of turn */
    ADAPTIVE_CURRENT = 11,  /* m/s, 2 states: of the water, north and east */
    ADAPTIVE_STATES = 13
};

/* Standard deviations. */
typedef struct {
    double deviation[5];      /* rad: what is not known beforehand of A to E */
    double deviation_walk;    /* rad per root second: how each changes */
    double bias;              /* rad/s */
    double bias_walk;         /* rad/s per root second */
    double gain;              /* of 1 */
    double gyro;              /* rad per root second: noise of the integrated yaw */
    double unseen_turn;       /* rad/s per root second: how the rate of turn changes while there is no gyro */
    double unseen_rate;       /* rad/s: how far it can be from the last one seen */
    double lag_mean;          /* s: of the compass, on top of its latency */
    double lag;               /* s */
    double speed_walk;        /* m/s per root second */
    double pivot;             /* m: how far ahead of her reference point a boat is thought to pivot */
    double slip;              /* m: how far off that may be */
    double current[2];        /* m/s per axis: first covariance of the hypotheses without and with a current */
    double current_walk[2];   /* m/s per root second */
    double compass;           /* rad: of the compass, slow errors and waves */
    double compass_memory_s;  /* s: their correlation time */
    double compass_quick;     /* rad: what one tick's mean adds */
    double velocity;          /* m/s per axis: of a receiver with HDOP 1 */
    double velocity_memory_s; /* s: its correlation time */
    double position;          /* m per axis: how two positions of a receiver with HDOP 1 err apart within seconds */
    double waves;             /* m/s per axis: how waves move the boat */
    double waves_memory_s;    /* s */
    double aside_per_turn;    /* m: sideways speed not understood, per rate of turn */
} adaptive_noise_t;

/* What a compass said over a tick. */
typedef struct {
    double offset;   /* rad: its true heading minus the gyro's yaw at the time */
    double basis[5]; /* 1, sin, cos, sin 2, cos 2 of its heading */
    double age;      /* s from the reading to the tick */
    double rate;     /* rad/s, of the gyro at the time */
    double turning;  /* 0 to 1: whether the boat turns, or waves only yaw her */
    int n;           /* readings */
} adaptive_bearing_t;

/* What the receivers said over a tick. */
typedef struct {
    double north; /* m/s over ground */
    double east;
    double yaw;      /* rad, the gyro's, at the time */
    double rate;     /* rad/s: of turn, smoothed */
    double course;   /* rad: what she steers, and */
    double speed;    /* m/s: how fast, both held while waves only play about them */
    double turning;  /* 0 to 1: whether the boat turns, or waves only yaw her */
    double age;      /* s from the time to the tick */
    double variance; /* m^2/s^2 per axis, of a tick's mean as if errors had no memory */
} adaptive_velocity_t;

/* How a filter took a measurement. */
typedef struct {
    int accepted;
    double log_likelihood; /* of what was accepted, but for a constant; of what was refused, as at the gate */
    double nis;            /* normalised innovation squared of the row that shows the heading */
} adaptive_verdict_t;

/* Starts the filter near an offset (rad) that nothing has measured yet, at a speed (m/s). */
void adaptive_model_start(adaptive_ekf_t *ekf, const adaptive_noise_t *noise, int with_current, double offset,
                          double speed);

/* Likewise, but with what it has learned of all else. */
void adaptive_model_start_again(adaptive_ekf_t *ekf, double offset, double speed);

/* Predicts over dt seconds, in which the gyro turned by `turned` (rad); gyro_live: it was heard. */
void adaptive_model_predict(adaptive_ekf_t *ekf, const adaptive_noise_t *noise, int with_current, double dt,
                            double turned, int gyro_live);

/* Makes a state anew: mean and variance, without what it had in common with others. */
void adaptive_model_renew(adaptive_ekf_t *ekf, int state, double mean, double variance);

/* Takes a tick's compass bearing; `tick_s`: length of a tick. */
adaptive_verdict_t adaptive_model_take_bearing(adaptive_ekf_t *ekf, const adaptive_noise_t *noise,
                                               const adaptive_bearing_t *bearing, double tick_s, int gyro_live);

/* Takes a tick's velocity over ground. */
adaptive_verdict_t adaptive_model_take_velocity(adaptive_ekf_t *ekf, const adaptive_noise_t *noise,
                                                const adaptive_velocity_t *velocity, double tick_s);

/* Takes the boat for lying still while the gyro showed `rate` (rad/s). */
void adaptive_model_take_rest(adaptive_ekf_t *ekf, double rate);

#endif
