/* The adaptive method: one heading from the gyro's yaw, the compass and the velocity over ground that the receivers agree
 * on, by two filters that differ in what they believe of the current, weighed by how well each foretold what was measured.
 * docs/adaptive.md says what it does and why. Works in ticks of 200 ms of the sample clock; between them the gyro carries
 * the heading. */
#ifndef ADAPTIVE_H
#define ADAPTIVE_H

#include "adaptive_model.h"
#include "angle.h"
#include "ground_velocity.h"
#include "sample.h"
#include "source_clock.h"
#include "yaw_history.h"

enum { ADAPTIVE_CALM = 0, ADAPTIVE_CURRENTED = 1, ADAPTIVE_HYPOTHESES = 2 };

typedef struct {
    double latency_s[SAMPLE_IMU + 1]; /* by source: from the moment measured to the stamp */
    double current_chance;            /* how likely a current is, before anything is measured */
    double unmodelled;                /* rad: standard deviation of what no sensor aboard can see, as leeway */
    double arm[SAMPLE_MAX_GPS][2];    /* m: each antenna's place, ahead and to starboard of the reference point */
    adaptive_noise_t noise;
} adaptive_settings_t;

/* What suits a boat with the usual devices; its units are those of the structs. */
#define ADAPTIVE_SETTINGS                                                                                              \
    {                                                                                                                  \
        .latency_s = {0.12, 0.12, 0.12, 0.12, 0.12, 0.12, 0.12, 0.12, 0.05, 0.0}, .current_chance = 0.1,               \
        .unmodelled = 0.25 * ANGLE_DEGREE,                                                                             \
        .noise = {                                                                                                     \
            .deviation = {1.2 * ANGLE_DEGREE, 2.3 * ANGLE_DEGREE, 2.3 * ANGLE_DEGREE, 0.9 * ANGLE_DEGREE,              \
                          0.7 * ANGLE_DEGREE},                                                                         \
            .deviation_walk = 0.005 * ANGLE_DEGREE,                                                                    \
            .bias = 1.0 * ANGLE_DEGREE,                                                                                \
            .bias_walk = 0.005 * ANGLE_DEGREE,                                                                         \
            .gain = 0.01,                                                                                              \
            .gyro = 0.03 * ANGLE_DEGREE,                                                                               \
            .unseen_turn = 1.5 * ANGLE_DEGREE,                                                                         \
            .unseen_rate = 2.0 * ANGLE_DEGREE,                                                                         \
            .lag_mean = 0.25,                                                                                          \
            .lag = 0.2,                                                                                                \
            .speed_walk = 0.03,                                                                                        \
            .pivot = 1.5,                                                                                              \
            .slip = 0.5,                                                                                               \
            .current = {0.03, 0.35},                                                                                   \
            .current_walk = {0.0005, 0.002},                                                                           \
            .compass = 0.7 * ANGLE_DEGREE,                                                                             \
            .compass_memory_s = 8.0,                                                                                   \
            .compass_quick = 0.4 * ANGLE_DEGREE,                                                                       \
            .velocity = 0.08,                                                                                          \
            .velocity_memory_s = 1.0,                                                                                  \
            .position = 0.1,                                                                                           \
            .waves = 0.06,                                                                                             \
            .waves_memory_s = 0.6,                                                                                     \
            .aside_per_turn = 0.5,                                                                                     \
        },                                                                                                             \
    }

/* Sums of one receiver's velocities within a tick. */
typedef struct {
    double north;
    double east;
    double yaw;
    double age; /* s after the tick's begin, of the moments measured */
    double variance;
    int n;
    int64_t suspect_until_us; /* it has lately contradicted the others */
} adaptive_receiver_t;

/* What had been learned before the compass began to repeat itself, in case it was stuck. */
typedef struct {
    adaptive_ekf_t filter[ADAPTIVE_HYPOTHESES];
    double log_odds;
    int64_t t_us; /* SOURCE_NEVER: nothing */
} adaptive_kept_t;

typedef struct {
    adaptive_settings_t settings;
    yaw_history_t yaw;
    double smooth_rate;                 /* rad/s: of turn, behind a lag like that of the boat's sideslip */
    double turning;                     /* 0 to 1: whether the boat turns, or waves only yaw her */
    double heading;                     /* rad: at the last tick */
    double course[ADAPTIVE_HYPOTHESES]; /* rad: what she steers by each filter, held between turns */
    double speed[ADAPTIVE_HYPOTHESES];  /* m/s: likewise */
    double shown;                       /* rad: likewise, what the compass shows */
    double wave_yaw;                    /* rad: how far waves have turned her from the course steered */
    int64_t tick_us;                    /* the last tick; SOURCE_NEVER before the first sample */
    double tick_yaw;                    /* rad: the gyro's yaw then */
    int running;                        /* there is a heading */
    int gyro_live;                      /* at the last tick */
    double bias_before;                 /* rad/s: mean and variance of the gyro's bias when it fell silent */
    double bias_variance_before[ADAPTIVE_HYPOTHESES];
    double bias_of[ADAPTIVE_HYPOTHESES];
    int64_t silent_since_us; /* when */

    adaptive_ekf_t filter[ADAPTIVE_HYPOTHESES];
    double log_odds;           /* of a current */
    int64_t evidence_until_us; /* after this nothing tells a current from a deviation, until she turns again */
    double nis;                /* sum of the likelier filter's normalised innovations squared of the heading, */
    int headings;              /* and their number */
    adaptive_kept_t kept;
    int misled;       /* by a stuck compass: the next tick goes back to what was kept */
    int learned;      /* and the filters hold that at the next start */
    double unsettled; /* rad: of the tick's correction, what the heading given out has yet to follow */

    double bearing_reference; /* rad: about which the tick's compass readings are summed */
    adaptive_bearing_t bearing;
    adaptive_receiver_t receiver[SAMPLE_MAX_GPS];
    ground_track_t track[SAMPLE_MAX_GPS];
    int64_t velocity_us; /* when a receiver last gave a velocity */

    double gyro_rate;  /* rad/s: over the last tick, bias and all */
    double mean_north; /* m/s over ground, of the last seconds */
    double mean_east;
    int at_rest;
    int64_t bearing_taken_us;   /* when the compass was last believed; SOURCE_NEVER: not yet */
    int64_t bearing_hold_us;    /* it is not taken before this */
    int64_t bearing_refused_us; /* since when it has been refused; SOURCE_NEVER: is not */
    int64_t contradicted_us;    /* since when everything has been refused; SOURCE_NEVER: is not */
} adaptive_t;

void adaptive_reset(adaptive_t *adaptive, const adaptive_settings_t *settings);

/* Runs the ticks due up to a moment. Call before each sample. */
void adaptive_advance(adaptive_t *adaptive, int64_t t_us);

/* The gyro turned by an angle (rad) up to t_us, at a rate (rad/s). */
void adaptive_turn(adaptive_t *adaptive, int64_t t_us, double angle, double rate);

/* The compass showed a true heading (rad). */
void adaptive_bear(adaptive_t *adaptive, int64_t t_us, double heading);

/* The compass shows something new: what was learned up to now is worth keeping. */
void adaptive_keep(adaptive_t *adaptive);

/* The compass was stuck: the heading starts anew, and what was learned since the compass began to repeat itself is
 * forgotten. */
void adaptive_unlearn(adaptive_t *adaptive);

/* Receiver i, of stage-1 weight `weight`, gave a fix: with speed and course, or without them. */
void adaptive_move(adaptive_t *adaptive, int64_t t_us, int i, const gps_reading_t *reading, double weight);

/* Heading at a moment (rad) and its standard deviation (rad); 0 when there is none yet. */
int adaptive_heading(const adaptive_t *adaptive, int64_t t_us, double *heading, double *sigma);

#endif
