/* libFuzzer on the C core's door: whatever samples and switches come, no row holds an infinity, and a heading that is
 * called valid is a number from 0 to 360. Built with -fsanitize=fuzzer,address,undefined by `make fuzz`. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "fusion.h"

#define MAX_SAMPLES 64
#define ROWS 256

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void require(int holds)
{
    if (!holds) {
        abort();
    }
}

static void check(const estimate_t *row)
{
    require(!isinf(row->heading_sigma_deg) && !isinf(row->lat_deg) && !isinf(row->lon_deg));
    if (row->mode != FUSION_INVALID) {
        require(row->heading_deg >= 0.0 && row->heading_deg <= 360.0);
        require(row->heading_sigma_deg >= 0.0);
    }
    if (row->pos_mode != FUSION_INVALID) {
        require(isfinite(row->lat_deg) && isfinite(row->lon_deg));
    }
}

/* One control byte before each sample: a switch of a task, or how the bits of the sample are to be read. */
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    static fusion_t fusion;
    static estimate_t rows[ROWS];
    if (size < 2) {
        return 0;
    }
    fusion_settings_t settings = fusion_default_settings;
    settings.method = (fusion_method_t)(bytes[0] % 3);
    settings.n_gps = bytes[1] % (SAMPLE_MAX_GPS + 1);
    settings.has_compass = bytes[1] >> 4 & 1;
    settings.has_imu = bytes[1] >> 5 & 1;
    settings.wants_variation = bytes[1] >> 6 & 1;
    settings.specific_force = bytes[1] >> 7;
    settings.has_compass |= settings.n_gps == 0;
    if (fusion_init(&fusion, &settings) != EKF_ACCEPTED) {
        return 0;
    }
    size_t at = 2;
    int64_t t_us = 0;
    for (int n = 0; n < MAX_SAMPLES && at < size; n++) {
        const uint8_t control = bytes[at++];
        if (control < 32) {
            const int task = control & 15;
            fusion_set_task(&fusion, task, control >> 4);
            fusion_set_poll(&fusion, task - 3, control >> 4);
            continue;
        }
        sample_t sample;
        memset(&sample, 0, sizeof sample);
        const size_t left = size - at;
        const size_t taken = left < sizeof sample ? left : sizeof sample;
        memcpy(&sample, bytes + at, taken);
        at += taken;
        if (control & 64) { /* a stamp near the last one: others are refused or lead through a minute of rows */
            t_us += (sample.t_us & 0x1fffff) - 0x40000;
            sample.t_us = t_us;
        } else {
            sample.t_us %= INT64_C(60000000);
        }
        if (control & 128) {
            sample.source = (int32_t)((uint32_t)sample.source % 12) - 1;
        }
        for (int fed = 0; fed < 1;) {
            int n_rows = 0;
            fed += fusion_run(&fusion, &sample, 1, rows, ROWS, &n_rows);
            for (int i = 0; i < n_rows; i++) {
                check(&rows[i]);
            }
            if (fusion.variation_wanted) {
                fusion_set_variation(&fusion, control & 1 ? (double)NAN : -0.14);
            }
        }
    }
    if (fusion.now_us != INT64_MIN) {
        fusion_estimate(&fusion, fusion.now_us, &rows[0]);
        check(&rows[0]);
    }
    return 0;
}
