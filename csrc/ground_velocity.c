#include "ground_velocity.h"

#include <math.h>

#include "angle.h"
#include "local_frame.h"
#include "source_clock.h"

static const double still = 0.35; /* m/s: a receiver with a blank course and less speed says that she lies still */
static const double shortest_baseline_s = 2.0; /* over less, a track shows the positions' noise */
static const double longest_baseline_s = 3.0;  /* over more, the boat's turns; and adaptive's yaw history ends */

int ground_velocity_own(const gps_reading_t *reading, ground_velocity_t *velocity)
{
    const double speed = reading->speed_mps;
    const double course = reading->course_deg * ANGLE_DEGREE;
    if (!(speed >= 0.0 && speed < INFINITY) || (!isfinite(course) && speed > still)) {
        return 0;
    }
    velocity->north = isfinite(course) ? speed * cos(course) : 0.0;
    velocity->east = isfinite(course) ? speed * sin(course) : 0.0;
    return 1;
}

int ground_velocity_of_track(ground_track_t *track, const gps_reading_t *reading, int64_t t_us,
                             ground_velocity_t *velocity, double *span)
{
    *span = source_seconds_since(track->t_us, t_us);
    if (*span >= 0.0 && *span < shortest_baseline_s) {
        return 0;
    }
    const ground_track_t before = *track;
    *track = (ground_track_t){reading->lat_deg, reading->lon_deg, t_us};
    if (!(*span >= 0.0 && *span <= longest_baseline_s)) {
        return 0;
    }
    local_frame_t frame;
    local_frame_set(&frame, before.lat_deg * ANGLE_DEGREE, before.lon_deg * ANGLE_DEGREE);
    local_frame_to_metres(&frame, reading->lat_deg * ANGLE_DEGREE, reading->lon_deg * ANGLE_DEGREE, &velocity->north,
                          &velocity->east);
    velocity->north /= *span;
    velocity->east /= *span;
    return 1;
}
