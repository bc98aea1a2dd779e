/* One measurement of one sensor, as decoders make it and the fusion takes it: 112 bytes, the same in a worker's message,
 * in a NumPy array and here. Units are the sensors' own and stand in the names; the fusion converts at its door.
 * Missing numbers are NaN, missing counts -1. The Python twin is acquisition/sample.py. */
#ifndef SAMPLE_H
#define SAMPLE_H

#ifndef TINYEKF_CDEF
#include <stdint.h>
#endif

enum {
    SAMPLE_MAX_GPS = 8, /* sources 0 to 7 are gps1 to gps8 */
    SAMPLE_COMPASS = 8,
    SAMPLE_IMU = 9
};

/* What a compass heading refers to. */
enum {
    SAMPLE_REFERENCE_COMPASS = 0, /* as the instrument reads: deviation and variation still to be applied */
    SAMPLE_REFERENCE_TRUE = 1
};

typedef struct {
    double utc_s;         /* since 1970-01-01 */
    double lat_deg;       /* WGS-84, north positive */
    double lon_deg;       /* east positive */
    double altitude_m;    /* above mean sea level */
    double speed_mps;     /* over ground */
    double course_deg;    /* over ground, true */
    double hdop;          /* horizontal dilution of precision */
    double variation_deg; /* east positive */
    int32_t satellites;
} gps_reading_t;

typedef struct {
    double heading_deg;
    double deviation_deg; /* the sentence's own, east positive; replaces the configured table */
    double variation_deg; /* the sentence's own, east positive */
    double pitch_deg;     /* bow up positive */
    double roll_deg;      /* starboard down positive */
} compass_reading_t;

typedef struct {
    double attitude_deg[3]; /* the IMU's own roll, pitch, yaw: recorded, never fused */
    double gyro_dps[3];
    double accel_g[3];
    double mag_ut[3];
} imu_reading_t;

typedef struct {
    int64_t t_us;   /* monotonic, since the recording's start */
    int32_t source; /* 0 to 7: a GPS; SAMPLE_COMPASS; SAMPLE_IMU */
    int32_t code;   /* GPS: fix quality as in GGA, -1 unknown; compass: a SAMPLE_REFERENCE_ */
    union {
        gps_reading_t gps;
        compass_reading_t compass;
        imu_reading_t imu;
    };
} sample_t;

#endif
