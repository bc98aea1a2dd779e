#include "local_frame.h"

#include <math.h>

#include "angle.h"

static const double semi_major_m = 6378137.0;
static const double eccentricity_squared = 6.69437999014131699614e-3;
static const double smallest_cosine = 1e-6; /* keeps the longitude scale finite at the poles */

void local_frame_set(local_frame_t *frame, double lat, double lon)
{
    const double sine = sin(lat);
    const double w2 = 1.0 - eccentricity_squared * sine * sine;
    const double prime_vertical = semi_major_m / sqrt(w2);
    frame->lat0 = lat;
    frame->lon0 = lon;
    frame->metres_lat = prime_vertical * (1.0 - eccentricity_squared) / w2;
    frame->metres_lon = prime_vertical * fmax(cos(lat), smallest_cosine);
}

void local_frame_to_metres(const local_frame_t *frame, double lat, double lon, double *north, double *east)
{
    *north = (lat - frame->lat0) * frame->metres_lat;
    *east = angle_wrap(lon - frame->lon0) * frame->metres_lon;
}

void local_frame_to_position(const local_frame_t *frame, double north, double east, double *lat, double *lon)
{
    *lat = frame->lat0 + north / frame->metres_lat;
    *lon = angle_wrap(frame->lon0 + east / frame->metres_lon);
}
