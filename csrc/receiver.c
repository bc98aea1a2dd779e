#include "receiver.h"

#include <math.h>

#include "angle.h"
#include "cnw.h"

static const double longest_baseline_s = 2.0; /* an older position makes no azimuth */
static const double speed_holds_s = 2.0;

void receiver_reset(receiver_t *receiver)
{
    *receiver =
        (receiver_t){.position_us = SOURCE_NEVER, .speed_us = SOURCE_NEVER, .azimuth_us = SOURCE_NEVER, .azimuth = NAN};
    source_clock_reset(&receiver->clock);
}

static int is_position(const gps_reading_t *gps)
{
    return fabs(gps->lat_deg) <= 90.0 && fabs(gps->lon_deg) <= 360.0;
}

void receiver_take(receiver_t *receiver, const sample_t *sample, int64_t t_us, int stage1_runs)
{
    const gps_reading_t *gps = &sample->gps;
    source_clock_tick(&receiver->clock, t_us);
    receiver->valid = sample->code >= 1 && is_position(gps);
    receiver->weight = 0.0;
    if (gps->speed_mps >= 0.0 && gps->speed_mps < INFINITY) {
        receiver->speed = gps->speed_mps;
        receiver->speed_us = t_us;
    }
    double azimuth = NAN;
    if (receiver->valid) {
        if (source_seconds_since(receiver->position_us, t_us) <= longest_baseline_s) {
            azimuth = angle_forward_azimuth(receiver->lat_deg, receiver->lon_deg, gps->lat_deg, gps->lon_deg);
        }
        receiver->lat_deg = gps->lat_deg;
        receiver->lon_deg = gps->lon_deg;
        receiver->position_us = t_us;
        receiver->weight = stage1_runs ? cnw_stage1(sample->code, gps->hdop) : 1.0;
    }
    receiver->azimuth = azimuth;
    if (isfinite(azimuth)) {
        receiver->azimuth_us = t_us;
    }
}

int receiver_has_fix(const receiver_t *receiver, int64_t now_us)
{
    return receiver->valid && source_clock_is_fresh(&receiver->clock, now_us);
}

int receiver_carries_heading(const receiver_t *receiver, int64_t now_us)
{
    return receiver_has_fix(receiver, now_us) && receiver->azimuth_us != SOURCE_NEVER &&
           now_us - receiver->azimuth_us <= source_clock_patience_us(&receiver->clock);
}

double receiver_weight(const receiver_t *receiver, int64_t now_us)
{
    return receiver_has_fix(receiver, now_us) ? receiver->weight : 0.0;
}

double receiver_azimuth(const receiver_t *receiver, int64_t now_us)
{
    return receiver_has_fix(receiver, now_us) ? receiver->azimuth : NAN;
}

double receiver_speed(const receiver_t *receiver, int64_t now_us)
{
    return source_seconds_since(receiver->speed_us, now_us) <= speed_holds_s ? receiver->speed : 0.0;
}
