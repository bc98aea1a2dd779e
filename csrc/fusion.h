/* The whole way from samples to one heading, as one static struct: feed it samples in the order in which they arrived,
 * and take a row for each point of the 100 ms grid that they passed. docs/fusion.md says exactly what it computes.
 * A pure function of its settings and the sequence of calls: no clock, no allocation, no globals. */
#ifndef FUSION_H
#define FUSION_H

#include "adaptive.h"
#include "attitude.h"
#include "heading_filter.h"
#include "local_frame.h"
#include "receiver.h"
#include "sample.h"
#include "source_clock.h"
#include "stuck.h"

#define FUSION_GRID_US 100000 /* one row every 100 ms */

typedef enum {
    FUSION_CNW_EKF = 0, /* the 2018 paper: stages 1 and 2, one filter */
    FUSION_CNW3 = 1,    /* the 2019 paper: three stages, a filter for each GPS */
    FUSION_EKF_CI = 2,  /* its predecessor: covariance intersection of the filters */
    FUSION_ADAPTIVE = 3 /* ours (adaptive.h), beside the filters of the card, which give the position */
} fusion_method_t;

typedef enum {
    FUSION_OK = 0,
    FUSION_DEGRADED = 1,       /* a configured source is missing, stopped or refused, or a stage is stopped */
    FUSION_DEAD_RECKONING = 2, /* the gyro alone carries the heading, or nothing the position */
    FUSION_GPS = 3,            /* position only: some receiver has a fix */
    FUSION_INVALID = 4
} fusion_mode_t;

/* The stages that can be stopped; filters are FUSION_EKF1 + i. Polls are stopped by source number. */
enum { FUSION_STAGE1 = 0, FUSION_STAGE2 = 1, FUSION_STAGE3 = 2, FUSION_EKF1 = 3, FUSION_TASKS = 11 };

typedef struct {
    fusion_method_t method;
    int n_gps;           /* highest number of a receiver configured, 0 to 8 */
    uint32_t absent_gps; /* bit i: gps(i+1), though numbered, is not aboard */
    int has_compass;     /* configured */
    int has_imu;         /* configured */
    int ekf_gps;         /* the receiver whose filter cnw-ekf runs, from 0 */
    double deviation[5]; /* A to E, rad: A + B sin z + C cos z + D sin 2z + E cos 2z at compass heading z */
    double variation;    /* rad, east positive; NaN: from the sentences */
    int wants_variation; /* ask for the variation where the boat is (fusion_t.variation_wanted) */
    double mount[3][3];  /* turns the IMU's axes into the boat's */
    double gyro_bias[3]; /* deg/s, taken off the gyro's readings in its own axes */
    int specific_force;  /* the accelerometer shows (0, 0, -1) at rest instead of (0, 0, +1) */
    double max_sigma;    /* rad: a less certain heading is invalid */
    heading_noise_t noise;
    adaptive_settings_t adaptive;
} fusion_settings_t;

/* Method cnw3, three receivers, compass and IMU, no deviation, unknown variation, the papers' noise, 30 degrees. */
extern const fusion_settings_t fusion_default_settings;

/* A row of the heading CSV; degrees, NaN where missing. */
typedef struct {
    int64_t t_us;
    double heading_deg;
    double heading_sigma_deg;
    double rate_of_turn_dps;
    double lat_deg;
    double lon_deg;
    int32_t mode;     /* a fusion_mode_t */
    int32_t pos_mode; /* FUSION_GPS, FUSION_DEAD_RECKONING or FUSION_INVALID */
    double weight[SAMPLE_MAX_GPS];
    double faz_deg[SAMPLE_MAX_GPS];
    double gpsec_deg;
    double ekf_deg[SAMPLE_MAX_GPS];
} estimate_t;

/* What became of a sample. */
typedef enum {
    FUSION_TAKEN = 0,
    FUSION_STOPPED = 1,      /* its poll is off */
    FUSION_UNKNOWN = 2,      /* no such source is configured */
    FUSION_BACKWARDS = 3,    /* more than a second older than the newest */
    FUSION_INCOMPLETE = 4,   /* nothing in it that counts (an IMU without rates, a compass without heading) */
    FUSION_NO_VARIATION = 5, /* a compass heading that cannot be made true yet */
    FUSION_STUCK = 6,        /* a compass or an IMU that repeats itself where it cannot */
    FUSION_VERDICTS = 7
} fusion_verdict_t;

typedef struct {
    fusion_settings_t settings;
    int64_t now_us;      /* the newest stamp; SOURCE_NEVER before the first */
    int64_t next_row_us; /* grid point of the next row */

    receiver_t gps[SAMPLE_MAX_GPS];
    heading_filter_t filter[SAMPLE_MAX_GPS];
    int compass_filter; /* no receiver is configured: the first filter runs without one */

    source_clock_t compass_clock;
    stuck_compass_t compass_reading;
    double compass; /* true heading, rad */

    source_clock_t imu_clock;
    stuck_imu_t imu_reading;
    attitude_t attitude;
    double rate;      /* yaw rate, rad/s: the last one, or the mean of those sharing the last stamp */
    double rate_span; /* s: the interval that those rates share */
    int rate_count;   /* how many share the last stamp */

    adaptive_t adaptive; /* idle with another method */

    local_frame_t frame;
    int has_frame;
    int64_t fix_us;           /* stamp of the last valid position of any receiver */
    double gps_variation;     /* rad, the last one that a GPS gave; NaN: none */
    int variation_wanted;     /* the boat is at a new place, lat, lon, utc below; cleared by fusion_set_variation */
    double variation_lat_deg; /* where */
    double variation_lon_deg;
    double variation_utc_s; /* when */
    int has_variation_place;

    int stopped[FUSION_TASKS];
    uint64_t verdicts[FUSION_VERDICTS]; /* how many samples got each fusion_verdict_t */
} fusion_t;

/* Starts anew. EKF_REFUSED when a setting is out of range. */
ekf_status_t fusion_init(fusion_t *fusion, const fusion_settings_t *settings);

/* Takes one sample. */
fusion_verdict_t fusion_feed(fusion_t *fusion, const sample_t *sample);

/* Writes the next row that is due before a sample of stamp t_us is fed; 0 when none is. Call until it is 0, then feed. */
int fusion_next_row(fusion_t *fusion, int64_t t_us, estimate_t *row);

/* The estimate at a moment that is not before the newest stamp. */
void fusion_estimate(const fusion_t *fusion, int64_t t_us, estimate_t *estimate);

/* Feeds up to n samples with their rows; stops early when `rows` is full or a variation is wanted. Returns how many
 * samples were fed; *n_rows gets the number of rows written. */
int fusion_run(fusion_t *fusion, const sample_t *samples, int n, estimate_t *rows, int capacity, int *n_rows);

/* Sets the variation (rad, east positive; NaN: unknown, take the sentences') and answers variation_wanted. */
void fusion_set_variation(fusion_t *fusion, double variation);

/* Starts or stops a stage or filter (FUSION_STAGE1, ...). A stopped filter forgets its state. */
void fusion_set_task(fusion_t *fusion, int task, int running);

/* Starts or stops the poll of a source. */
void fusion_set_poll(fusion_t *fusion, int source, int running);

/* The port of a source hung up: it is not fresh from now on until its next sample. */
void fusion_lose(fusion_t *fusion, int source);

/* Mean normalised innovation squared of the headings taken so far: by the papers' filters, or by adaptive's likelier one
 * (of compass and velocity across the course). NaN before the first. */
double fusion_mean_nis(const fusion_t *fusion);

/* GPSEC_yaw of stage 2 at a moment, rad; NaN: none. */
double fusion_gpsec(const fusion_t *fusion, int64_t now_us);

/* Whether receiver i (from 0) is configured. */
int fusion_has_gps(const fusion_t *fusion, int i);

/* Whether the filter of receiver i belongs to the method and is not stopped. */
int fusion_uses_filter(const fusion_t *fusion, int i);

/* The yaw rate at a moment, rad/s: 0 when the IMU is not fresh. */
double fusion_rate(const fusion_t *fusion, int64_t now_us);

#endif
