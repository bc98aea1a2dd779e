#include "fusion_intake.h"

#include <math.h>
#include <stddef.h>

#include "angle.h"

static const int64_t gps_silent_us = 150000; /* then the compass moves a filter in the GPS' place */
static const double longest_rate_span_s = 1.0;
static const double frame_reach_m = 5000.0;
static const double variation_reach_deg = 0.5; /* the variation is asked for anew this far away */

static void advance(fusion_t *fusion, int i, double speed)
{
    heading_filter_advance(&fusion->filter[i], fusion->now_us, speed, fusion_rate(fusion, fusion->now_us),
                           &fusion->settings.noise);
}

/* Updates every filter whose own GPS is silent, but `except`, with the heading of stage 2. */
static void carry_silent_filters(fusion_t *fusion, int except)
{
    const double z[3] = {NAN, NAN, fusion_gpsec(fusion, fusion->now_us)};
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        const source_clock_t *clock = &fusion->gps[i].clock;
        const int silent = clock->last_us == SOURCE_NEVER || fusion->now_us - clock->last_us > gps_silent_us;
        if (i != except && silent && fusion_uses_filter(fusion, i)) {
            advance(fusion, i, receiver_speed(&fusion->gps[i], fusion->now_us));
            heading_filter_measure(&fusion->filter[i], fusion->now_us, z, &fusion->settings.noise);
        }
    }
}

/* Position of a receiver in metres. The frame begins at the first one, and follows a boat that leaves its reach. */
static void place(fusion_t *fusion, const receiver_t *gps, double *north, double *east)
{
    const double lat = gps->lat_deg * ANGLE_DEGREE;
    const double lon = gps->lon_deg * ANGLE_DEGREE;
    if (!fusion->has_frame) {
        local_frame_set(&fusion->frame, lat, lon);
        fusion->has_frame = 1;
    }
    local_frame_to_metres(&fusion->frame, lat, lon, north, east);
    if (hypot(*north, *east) <= frame_reach_m) {
        return;
    }
    const local_frame_t old = fusion->frame;
    local_frame_set(&fusion->frame, lat, lon);
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        ekf_real *x = fusion->filter[i].ekf.x;
        if (fusion->filter[i].running && fusion->filter[i].has_position) {
            double place_lat;
            double place_lon;
            double moved[2];
            local_frame_to_position(&old, (double)x[HEADING_NORTH], (double)x[HEADING_EAST], &place_lat, &place_lon);
            local_frame_to_metres(&fusion->frame, place_lat, place_lon, &moved[0], &moved[1]);
            x[HEADING_NORTH] = (ekf_real)moved[0];
            x[HEADING_EAST] = (ekf_real)moved[1];
        }
    }
    *north = 0.0;
    *east = 0.0;
}

/* Asks for the variation at the first place with a date, and again wherever the boat has gone far. */
static void ask_for_variation(fusion_t *fusion, const gps_reading_t *gps)
{
    if (!fusion->settings.wants_variation || !isfinite(gps->utc_s)) {
        return;
    }
    const double lon_distance = angle_wrap((gps->lon_deg - fusion->variation_lon_deg) * ANGLE_DEGREE) / ANGLE_DEGREE;
    if (!fusion->has_variation_place || fabs(gps->lat_deg - fusion->variation_lat_deg) > variation_reach_deg ||
        fabs(lon_distance) > variation_reach_deg) {
        fusion->variation_wanted = 1;
        fusion->has_variation_place = 1;
        fusion->variation_lat_deg = gps->lat_deg;
        fusion->variation_lon_deg = gps->lon_deg;
        fusion->variation_utc_s = gps->utc_s;
    }
}

/* While no gyro measures turns, a compass is stuck when most receivers deny what it repeats. */
static void judge_compass(fusion_t *fusion)
{
    int fixes = 0;
    int denials = 0;
    if (source_clock_is_fresh(&fusion->imu_clock, fusion->now_us) ||
        !source_clock_is_fresh(&fusion->compass_clock, fusion->now_us)) {
        return;
    }
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        const int has_fix = receiver_has_fix(&fusion->gps[i], fusion->now_us);
        fixes += has_fix;
        denials += has_fix && stuck_compass_is_denied(&fusion->compass_reading, fusion->now_us, i);
    }
    if (2 * denials > fixes) {
        fusion->compass_reading.stuck = 1;
        source_clock_lose(&fusion->compass_clock);
        adaptive_unlearn(&fusion->adaptive);
    }
}

fusion_verdict_t fusion_take_gps(fusion_t *fusion, int i, const sample_t *sample)
{
    receiver_t *gps = &fusion->gps[i];
    const int used = fusion_uses_filter(fusion, i);
    const double speed_before = receiver_speed(gps, fusion->now_us);
    double z[3] = {NAN, NAN, NAN};

    receiver_take(gps, sample, fusion->now_us, !fusion->stopped[FUSION_STAGE1]);
    if (isfinite(sample->gps.variation_deg)) {
        fusion->gps_variation = sample->gps.variation_deg * ANGLE_DEGREE;
    }
    if (used) {
        advance(fusion, i, speed_before);
    }
    if (gps->valid) {
        fusion->fix_us = fusion->now_us;
        place(fusion, gps, &z[HEADING_NORTH], &z[HEADING_EAST]);
        ask_for_variation(fusion, &sample->gps);
        if (fusion->settings.method == FUSION_ADAPTIVE) {
            adaptive_move(&fusion->adaptive, fusion->now_us, i, &sample->gps, gps->weight);
        }
        stuck_compass_move(&fusion->compass_reading, fusion->now_us, i, &sample->gps, fusion->compass);
        judge_compass(fusion);
    }
    if (used) {
        const double azimuth = receiver_azimuth(gps, fusion->now_us);
        z[HEADING_PSI] = isfinite(azimuth) ? azimuth : fusion_gpsec(fusion, fusion->now_us);
        heading_filter_measure(&fusion->filter[i], fusion->now_us, z, &fusion->settings.noise);
    }
    if (!source_clock_is_fresh(&fusion->compass_clock, fusion->now_us)) {
        carry_silent_filters(fusion, i);
    }
    return FUSION_TAKEN;
}

/* A compass reading as true heading (rad): compass + deviation = magnetic, magnetic + variation = true, east positive. */
static double true_heading(const fusion_t *fusion, const sample_t *sample)
{
    const compass_reading_t *reading = &sample->compass;
    const double zeta = reading->heading_deg * ANGLE_DEGREE;
    if (sample->code == SAMPLE_REFERENCE_TRUE) {
        return angle_wrap(zeta);
    }
    double deviation = reading->deviation_deg * ANGLE_DEGREE;
    if (!isfinite(deviation)) {
        const double *d = fusion->settings.deviation;
        deviation = d[0] + d[1] * sin(zeta) + d[2] * cos(zeta) + d[3] * sin(2.0 * zeta) + d[4] * cos(2.0 * zeta);
    }
    double variation = fusion->settings.variation;
    if (!isfinite(variation)) {
        variation = reading->variation_deg * ANGLE_DEGREE;
    }
    if (!isfinite(variation)) {
        variation = fusion->gps_variation;
    }
    return angle_wrap(zeta + deviation + variation);
}

fusion_verdict_t fusion_take_compass(fusion_t *fusion, const sample_t *sample)
{
    if (!isfinite(sample->compass.heading_deg)) {
        return FUSION_INCOMPLETE;
    }
    const double heading = true_heading(fusion, sample);
    if (!isfinite(heading)) {
        return FUSION_NO_VARIATION;
    }
    const int talks_on = source_clock_is_fresh(&fusion->compass_clock, fusion->now_us);
    const int repeats = stuck_compass_repeats(&fusion->compass_reading, sample->compass.heading_deg, talks_on);
    if (stuck_compass_take(&fusion->compass_reading, sample->compass.heading_deg, talks_on)) {
        source_clock_lose(&fusion->compass_clock);
        return FUSION_STUCK;
    }
    source_clock_tick(&fusion->compass_clock, fusion->now_us);
    fusion->compass = heading;
    if (fusion->settings.method == FUSION_ADAPTIVE) {
        if (!repeats) {
            adaptive_keep(&fusion->adaptive);
        }
        adaptive_bear(&fusion->adaptive, fusion->now_us, heading);
    }
    carry_silent_filters(fusion, -1);
    return FUSION_TAKEN;
}

static void turn_into_boat(const double mount[3][3], const double reading[3], double scale, double out[3])
{
    for (int i = 0; i < 3; i++) {
        out[i] = scale * (mount[i][0] * reading[0] + mount[i][1] * reading[1] + mount[i][2] * reading[2]);
    }
}

fusion_verdict_t fusion_take_imu(fusion_t *fusion, const sample_t *sample)
{
    if (stuck_imu_take(&fusion->imu_reading, &sample->imu, fusion->now_us)) {
        source_clock_lose(&fusion->imu_clock);
        return FUSION_STUCK;
    }
    double gyro[3];
    double gravity[3];
    double rates_dps[3];
    for (int i = 0; i < 3; i++) {
        rates_dps[i] = sample->imu.gyro_dps[i] - fusion->settings.gyro_bias[i];
    }
    const double sign = fusion->settings.specific_force ? -1.0 : 1.0;
    turn_into_boat((const double(*)[3])fusion->settings.mount, rates_dps, ANGLE_DEGREE, gyro);
    turn_into_boat((const double(*)[3])fusion->settings.mount, sample->imu.accel_g, sign, gravity);

    const int64_t before_us = fusion->imu_clock.last_us;
    const double since = before_us == SOURCE_NEVER ? 0.0 : source_seconds_since(before_us, fusion->now_us);
    const double rate = attitude_update(&fusion->attitude, gyro, gravity, since);
    if (!isfinite(rate)) {
        return FUSION_INCOMPLETE;
    }
    source_clock_tick(&fusion->imu_clock, fusion->now_us);
    if (before_us == fusion->now_us) { /* came in one read with the one before: they share its interval */
        fusion->rate_count++;
        const double change = (rate - fusion->rate) / fusion->rate_count;
        fusion->rate += change;
        adaptive_turn(&fusion->adaptive, fusion->now_us, fusion->rate_span * change, fusion->rate);
        stuck_compass_turn(&fusion->compass_reading, fusion->rate_span * change, 0.0);
        for (int i = 0; i < fusion->settings.n_gps; i++) {
            heading_filter_turn(&fusion->filter[i], fusion->rate_span * change);
        }
        return FUSION_TAKEN;
    }
    fusion->rate = rate;
    fusion->rate_count = 1;
    fusion->rate_span = fmin(since, longest_rate_span_s);
    adaptive_turn(&fusion->adaptive, fusion->now_us, rate * fusion->rate_span, rate);
    stuck_compass_turn(&fusion->compass_reading, rate * fusion->rate_span, fusion->rate_span);
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        advance(fusion, i, receiver_speed(&fusion->gps[i], fusion->now_us));
    }
    return FUSION_TAKEN;
}
