/* How a receiver moves over ground: what it says itself, or what its positions show. */
#ifndef GROUND_VELOCITY_H
#define GROUND_VELOCITY_H

#include "sample.h"

#define GROUND_VELOCITY_UNKNOWN_HDOP 2.0 /* of a receiver that does not say how good it is */

typedef struct {
    double north; /* m/s */
    double east;
} ground_velocity_t;

/* Where a receiver was some time ago: one that gives no velocity shows it by its way since then. */
typedef struct {
    double lat_deg;
    double lon_deg;
    int64_t t_us; /* SOURCE_NEVER: nowhere yet */
} ground_track_t;

/* What the receiver itself says; 0 when it does not say enough. */
int ground_velocity_own(const gps_reading_t *reading, ground_velocity_t *velocity);

/* Its way up to t_us over a baseline long enough to mean something, and that baseline (s); 0 until there is one. */
int ground_velocity_of_track(ground_track_t *track, const gps_reading_t *reading, int64_t t_us,
                             ground_velocity_t *velocity, double *span);

#endif
