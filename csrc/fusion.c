#include "fusion.h"

#include <math.h>
#include <stddef.h>

#include "angle.h"
#include "cnw.h"
#include "fusion_intake.h"

static const int64_t tolerated_disorder_us = 1000000; /* workers interleave; more is a clock gone wrong */

const fusion_settings_t fusion_default_settings = {
    .method = FUSION_CNW3,
    .n_gps = 3,
    .has_compass = 1,
    .has_imu = 1,
    .ekf_gps = 0,
    .variation = NAN,
    .mount = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}},
    .max_sigma = 30.0 * ANGLE_DEGREE,
    .noise = HEADING_NOISE_PAPER,
    .adaptive = ADAPTIVE_SETTINGS,
};

ekf_status_t fusion_init(fusion_t *fusion, const fusion_settings_t *settings)
{
    double finite = settings->max_sigma;
    for (int i = 0; i < 5; i++) {
        finite += settings->deviation[i];
    }
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        finite += settings->adaptive.arm[i][0] + settings->adaptive.arm[i][1];
    }
    for (int i = 0; i < 3; i++) {
        finite += settings->mount[i][0] + settings->mount[i][1] + settings->mount[i][2] + settings->gyro_bias[i];
        if (!(settings->noise.q[i] >= 0.0 && settings->noise.r[i] > 0.0 && settings->noise.p0[i] > 0.0)) {
            return EKF_REFUSED;
        }
    }
    const double chance = settings->adaptive.current_chance;
    if (!isfinite(finite) || !(chance > 0.0 && chance < 1.0) || settings->n_gps < 0 ||
        settings->n_gps > SAMPLE_MAX_GPS || settings->ekf_gps < 0 || settings->ekf_gps >= SAMPLE_MAX_GPS) {
        return EKF_REFUSED;
    }
    *fusion = (fusion_t){
        .settings = *settings,
        .now_us = SOURCE_NEVER,
        .fix_us = SOURCE_NEVER,
        .compass = NAN,
        .gps_variation = NAN,
    };
    int aboard = 0;
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        aboard += fusion_has_gps(fusion, i);
        receiver_reset(&fusion->gps[i]);
        heading_filter_reset(&fusion->filter[i]);
    }
    if (aboard == 0) { /* the first filter serves the compass alone */
        fusion->compass_filter = 1;
        fusion->settings.n_gps = 1;
        fusion->settings.absent_gps = 1;
    }
    source_clock_reset(&fusion->compass_clock);
    source_clock_reset(&fusion->imu_clock);
    stuck_compass_reset(&fusion->compass_reading);
    stuck_imu_reset(&fusion->imu_reading);
    attitude_reset(&fusion->attitude);
    adaptive_reset(&fusion->adaptive, &settings->adaptive);
    return EKF_ACCEPTED;
}

int fusion_has_gps(const fusion_t *fusion, int i)
{
    return i >= 0 && i < fusion->settings.n_gps && !(fusion->settings.absent_gps >> i & 1u);
}

int fusion_uses_filter(const fusion_t *fusion, int i)
{
    const int of_method = fusion->settings.method != FUSION_CNW_EKF || i == fusion->settings.ekf_gps;
    const int has_work = (fusion_has_gps(fusion, i) && of_method) || (fusion->compass_filter && i == 0);
    return has_work && !fusion->stopped[FUSION_EKF1 + i];
}

double fusion_rate(const fusion_t *fusion, int64_t now_us)
{
    return source_clock_is_fresh(&fusion->imu_clock, now_us) ? fusion->rate : 0.0;
}

double fusion_gpsec(const fusion_t *fusion, int64_t now_us)
{
    double azimuth[SAMPLE_MAX_GPS];
    double weight[SAMPLE_MAX_GPS];
    if (fusion->stopped[FUSION_STAGE2]) {
        return NAN;
    }
    int n = 0;
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        if (fusion_has_gps(fusion, i)) {
            azimuth[n] = receiver_azimuth(&fusion->gps[i], now_us);
            weight[n] = receiver_weight(&fusion->gps[i], now_us);
            n++;
        }
    }
    const double compass = source_clock_is_fresh(&fusion->compass_clock, now_us) ? fusion->compass : NAN;
    return cnw_stage2(azimuth, weight, n, compass);
}

/* The clock of a source; null where there is no such source. */
static source_clock_t *clock_of(fusion_t *fusion, int source)
{
    if (source >= 0 && source < SAMPLE_MAX_GPS) {
        return &fusion->gps[source].clock;
    }
    if (source == SAMPLE_COMPASS) {
        return &fusion->compass_clock;
    }
    return source == SAMPLE_IMU ? &fusion->imu_clock : NULL;
}

static fusion_verdict_t judge(fusion_t *fusion, const sample_t *sample)
{
    const int source = sample->source;
    const fusion_settings_t *settings = &fusion->settings;
    if (!(fusion_has_gps(fusion, source) || (source == SAMPLE_COMPASS && settings->has_compass) ||
          (source == SAMPLE_IMU && settings->has_imu))) {
        return FUSION_UNKNOWN;
    }
    if (clock_of(fusion, source)->stopped) {
        return FUSION_STOPPED;
    }
    if (fusion->now_us == SOURCE_NEVER) {
        const int64_t past = sample->t_us % FUSION_GRID_US;
        fusion->now_us = sample->t_us;
        fusion->next_row_us = sample->t_us - past + (past > 0 ? FUSION_GRID_US : 0);
    }
    if (sample->t_us < fusion->now_us - tolerated_disorder_us) {
        return FUSION_BACKWARDS;
    }
    if (sample->t_us > fusion->now_us) {
        fusion->now_us = sample->t_us;
    }
    if (fusion->settings.method == FUSION_ADAPTIVE) {
        adaptive_advance(&fusion->adaptive, fusion->now_us);
    }
    if (source == SAMPLE_COMPASS) {
        return fusion_take_compass(fusion, sample);
    }
    return source == SAMPLE_IMU ? fusion_take_imu(fusion, sample) : fusion_take_gps(fusion, source, sample);
}

fusion_verdict_t fusion_feed(fusion_t *fusion, const sample_t *sample)
{
    const fusion_verdict_t verdict = judge(fusion, sample);
    fusion->verdicts[verdict]++;
    return verdict;
}

int fusion_run(fusion_t *fusion, const sample_t *samples, int n, estimate_t *rows, int capacity, int *n_rows)
{
    *n_rows = 0;
    for (int i = 0; i < n; i++) {
        while (fusion->now_us != SOURCE_NEVER && fusion->next_row_us < samples[i].t_us) {
            if (*n_rows == capacity) {
                return i;
            }
            fusion_next_row(fusion, samples[i].t_us, &rows[(*n_rows)++]);
        }
        fusion_feed(fusion, &samples[i]);
        if (fusion->variation_wanted) {
            return i + 1;
        }
    }
    return n;
}

void fusion_set_variation(fusion_t *fusion, double variation)
{
    fusion->settings.variation = variation;
    fusion->variation_wanted = 0;
}

void fusion_set_task(fusion_t *fusion, int task, int running)
{
    if (task < 0 || task >= FUSION_TASKS) {
        return;
    }
    fusion->stopped[task] = !running;
    if (task >= FUSION_EKF1 && !running) {
        heading_filter_reset(&fusion->filter[task - FUSION_EKF1]);
    }
}

void fusion_set_poll(fusion_t *fusion, int source, int running)
{
    source_clock_t *clock = clock_of(fusion, source);
    if (clock) {
        clock->stopped = !running;
    }
}

void fusion_lose(fusion_t *fusion, int source)
{
    source_clock_t *clock = clock_of(fusion, source);
    if (clock) {
        source_clock_lose(clock);
    }
}
