/* libFuzzer on the C core's door: whatever samples and switches come, no row holds an infinity, and a heading that is
 * called valid is a number from 0 to 360. tests/fuzz/test_fuzz.py builds it, docs/fuzzing.md says how to run it for long.
 *
 * Most inputs spend six bytes on a sample and two on a switch, so that a short one already leads through tens of
 * samples: filters that run, sensors that fall silent, a boat that leaves her frame. A raw sample takes its numbers' bits
 * as they come: infinities, denormals, stamps that run backwards. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "fusion.h"

#define MAX_ITEMS 1024
#define ROWS 6 /* of a silence; the others would differ in nothing but how far they are predicted */

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

/* The input, taken from its beginning; zeros when it is used up. */
typedef struct {
    const uint8_t *at;
    size_t left;
} input_t;

static uint8_t take(input_t *input)
{
    if (input->left == 0) {
        return 0;
    }
    input->left--;
    return *input->at++;
}

/* A byte as a number: its least is `from`, a step is `step`; 255 is missing. */
static double number(input_t *input, double from, double step)
{
    const uint8_t byte = take(input);
    return byte == 255 ? (double)NAN : from + step * byte;
}

static void require(int holds)
{
    if (!holds) {
        abort();
    }
}

static int is_bearing_or_missing(double degrees)
{
    return isnan(degrees) || (degrees >= 0.0 && degrees <= 360.0);
}

static void check(const fusion_t *fusion, const estimate_t *row)
{
    require(!isinf(row->lat_deg) && !isinf(row->lon_deg) && !isinf(row->rate_of_turn_dps));
    require(is_bearing_or_missing(row->gpsec_deg));
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        require(is_bearing_or_missing(row->faz_deg[i]) && is_bearing_or_missing(row->ekf_deg[i]));
        require(isnan(row->weight[i]) || (row->weight[i] >= 0.0 && row->weight[i] <= 3.0));
    }
    if (row->mode == FUSION_INVALID) {
        require(isnan(row->heading_deg) && isnan(row->heading_sigma_deg));
    } else {
        require(row->heading_deg >= 0.0 && row->heading_deg <= 360.0);
        require(row->heading_sigma_deg >= 0.0 &&
                row->heading_sigma_deg * ANGLE_DEGREE <= fusion->settings.max_sigma * 1.001);
    }
    if (row->pos_mode != FUSION_INVALID) {
        require(isfinite(row->lat_deg) && isfinite(row->lon_deg));
    }
}

/* Time to the next sample, us: mostly milliseconds, now and then a silence of up to 30 s, now and then a step back. */
static int64_t step_us(uint8_t byte)
{
    const int64_t past = (int64_t)byte - 216;
    if (past < 0) {
        return byte * INT64_C(1000);
    }
    return past < 8 ? -past * INT64_C(200000) : (past - 8) * (past - 8) * (past - 8) * INT64_C(1000);
}

static void plausible(input_t *input, sample_t *sample)
{
    if (sample->source < SAMPLE_MAX_GPS) {
        const uint8_t quality = take(input);
        const double reach = quality & 128 ? 1e-3 : 1e-6; /* degrees: half a metre, or the frame's whole reach */
        sample->code = quality & 7;
        sample->gps = (gps_reading_t){
            .utc_s = quality & 64 ? (double)NAN : 1.8e9,
            .lat_deg = number(input, 36.0 - 128.0 * reach, reach),
            .lon_deg = number(input, 126.5 - 128.0 * reach, reach),
            .speed_mps = (quality & 7) * 0.9,
            .course_deg = number(input, 0.0, 1.44),
            .hdop = 0.5 * (1 << (quality >> 3 & 7)),
            .variation_deg = (double)NAN,
        };
    } else if (sample->source == SAMPLE_COMPASS) {
        sample->compass.heading_deg = number(input, 0.0, 1.44);
        sample->compass.deviation_deg = sample->compass.variation_deg = (double)NAN;
    } else {
        sample->imu.gyro_dps[2] = number(input, -127.0, 1.0);
        sample->imu.gyro_dps[0] = number(input, -12.7, 0.1);
        sample->imu.accel_g[1] = number(input, -1.27, 0.01);
        sample->imu.accel_g[2] = 1.0;
    }
}

static void raw(input_t *input, sample_t *sample)
{
    const int64_t t_us = sample->t_us;
    const size_t taken = input->left < sizeof *sample ? input->left : sizeof *sample;
    memcpy(sample, input->at, taken);
    input->at += taken;
    input->left -= taken;
    sample->t_us = sample->t_us & 1 ? t_us : sample->t_us % INT64_C(8000000);
}

static void feed(fusion_t *fusion, const sample_t *sample)
{
    estimate_t row;
    for (int n = 0; n < ROWS && fusion_next_row(fusion, sample->t_us, &row); n++) {
        check(fusion, &row);
    }
    if (fusion->now_us != SOURCE_NEVER && fusion->next_row_us < sample->t_us) {
        fusion->next_row_us = sample->t_us / FUSION_GRID_US * FUSION_GRID_US;
    }
    fusion_feed(fusion, sample);
    if (fusion->variation_wanted) {
        fusion_set_variation(fusion, sample->t_us & 1 ? (double)NAN : -0.14);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    static fusion_t fusion;
    input_t input = {bytes, size};
    const uint8_t method = take(&input);
    const uint8_t aboard = take(&input);
    fusion_settings_t settings = fusion_default_settings;
    settings.method = (fusion_method_t)(method & 3);
    settings.n_gps = aboard % (SAMPLE_MAX_GPS + 1);
    settings.absent_gps = method >> 2 & 7;
    settings.variation = method & 32 ? (double)NAN : -0.14;
    settings.has_compass = aboard >> 4 & 1;
    settings.has_imu = aboard >> 5 & 1;
    settings.wants_variation = aboard >> 6 & 1;
    settings.specific_force = aboard >> 7;
    if (fusion_init(&fusion, &settings) != EKF_ACCEPTED) {
        return 0;
    }
    sample_t sample = {0};
    int64_t t_us = 0;
    for (int n = 0; n < MAX_ITEMS && input.left > 0; n++) {
        const uint8_t kind = take(&input);
        if (kind < 32) {
            const int task = kind & 15;
            fusion_set_task(&fusion, task, kind >> 4);
            fusion_set_poll(&fusion, task - 3, kind >> 4);
            continue;
        }
        if (kind < 42) {
            fusion_lose(&fusion, kind - 32);
            continue;
        }
        t_us += step_us(take(&input));
        sample = (sample_t){.t_us = t_us, .source = kind & 15};
        if (kind < 48) {
            raw(&input, &sample);
        } else {
            sample.source = sample.source > SAMPLE_IMU ? SAMPLE_IMU : sample.source;
            plausible(&input, &sample);
        }
        feed(&fusion, &sample);
        t_us = fusion.now_us != SOURCE_NEVER && fusion.now_us > t_us ? fusion.now_us : t_us;
    }
    if (fusion.now_us != SOURCE_NEVER) {
        estimate_t last;
        fusion_estimate(&fusion, fusion.now_us, &last);
        check(&fusion, &last);
    }
    return 0;
}
