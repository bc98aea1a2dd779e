/* The fusion under sanitizers: whatever samples and switches come, in whatever order, it stays within its bounds and its
 * rows hold numbers a user can trust or nothing. The stream is random with a fixed seed. */
#include <math.h>
#include <stdint.h>

#include "expect.h"
#include "fusion.h"

static uint64_t state = 88172645463325252u;

static uint32_t draw(uint32_t n)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (uint32_t)(state >> 33) % n;
}

/* A number that a sensor, or a bug, might give. */
static double some(double low, double high)
{
    static const double odd[] = {NAN, INFINITY, -INFINITY, 0.0, -0.0, 1e300, -1e300, 1e-300, 360.0, -180.0, 90.0};
    if (draw(40) == 0) {
        return odd[draw(sizeof odd / sizeof odd[0])];
    }
    return low + (high - low) * draw(100001) / 100000.0;
}

static sample_t any_sample(int64_t t_us)
{
    sample_t sample = {.t_us = t_us, .source = (int32_t)draw(11)};
    if (draw(200) == 0) {
        sample.source = (int32_t)draw(1000) - 500;
    }
    if (sample.source >= 0 && sample.source < SAMPLE_MAX_GPS) {
        const double far = draw(100) == 0 ? 3.0 : 0.001;
        sample.code = (int32_t)draw(10) - 1;
        sample.gps = (gps_reading_t){
            .utc_s = some(1.7e9, 1.8e9),
            .lat_deg = some(36.0, 36.0 + far),
            .lon_deg = some(179.999, 179.999 + far),
            .speed_mps = some(0.0, 8.0),
            .course_deg = some(0.0, 360.0),
            .hdop = some(0.5, 12.0),
            .variation_deg = some(-20.0, 20.0),
        };
    } else if (sample.source == SAMPLE_COMPASS) {
        sample.code = (int32_t)draw(2);
        sample.compass = (compass_reading_t){
            .heading_deg = some(0.0, 360.0),
            .deviation_deg = draw(2) ? NAN : some(-5.0, 5.0),
            .variation_deg = draw(2) ? NAN : some(-20.0, 20.0),
        };
    } else {
        for (int i = 0; i < 3; i++) {
            sample.imu.gyro_dps[i] = some(-50.0, 50.0);
            sample.imu.accel_g[i] = some(-1.5, 1.5);
        }
    }
    return sample;
}

static int is_bearing_or_nan(double degrees)
{
    return isnan(degrees) || (degrees >= 0.0 && degrees < 360.0);
}

static void check_row(const fusion_t *fusion, const estimate_t *row)
{
    const int has_heading = row->mode != FUSION_INVALID;
    EXPECT(is_bearing_or_nan(row->heading_deg) && is_bearing_or_nan(row->gpsec_deg));
    EXPECT(has_heading == !isnan(row->heading_deg));
    EXPECT(!has_heading || (row->heading_sigma_deg > 0.0 && row->heading_sigma_deg < INFINITY));
    EXPECT((row->pos_mode != FUSION_INVALID) == !isnan(row->lat_deg));
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        EXPECT(is_bearing_or_nan(row->faz_deg[i]) && is_bearing_or_nan(row->ekf_deg[i]));
        EXPECT(isnan(row->weight[i]) == !fusion_has_gps(fusion, i));
    }
}

static void survives_anything(fusion_method_t method, int n_gps, int samples)
{
    fusion_settings_t settings = fusion_default_settings;
    fusion_t fusion;
    estimate_t row;
    int64_t t_us = 0;
    settings.method = method;
    settings.n_gps = n_gps;
    settings.wants_variation = 1;
    EXPECT(fusion_init(&fusion, &settings) == EKF_ACCEPTED);
    for (int k = 0; k < samples; k++) {
        t_us += draw(20000);
        if (draw(1000) == 0) {
            t_us += draw(30) * 1000000;
        }
        const int64_t stamp = draw(500) == 0 ? t_us - (int64_t)draw(5000000) : t_us;
        const sample_t sample = any_sample(stamp);
        while (fusion_next_row(&fusion, sample.t_us, &row)) {
            check_row(&fusion, &row);
        }
        EXPECT(fusion_feed(&fusion, &sample) < FUSION_VERDICTS);
        if (fusion.variation_wanted) {
            fusion_set_variation(&fusion, draw(4) ? some(-0.5, 0.5) : NAN);
        }
        if (draw(2000) == 0) {
            fusion_set_task(&fusion, (int)draw(14) - 1, (int)draw(2));
            fusion_set_poll(&fusion, (int)draw(12) - 1, (int)draw(2));
        }
    }
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        if (fusion.filter[i].running) {
            const ekf_t *ekf = &fusion.filter[i].ekf;
            EXPECT(isfinite((double)(ekf->x[0] + ekf->x[1] + ekf->x[2])));
            EXPECT(ekf->P[0][0] > 0 && ekf->P[1][1] > 0 && ekf->P[2][2] > 0);
        }
    }
}

static void refuses_settings_out_of_range(void)
{
    fusion_t fusion;
    fusion_settings_t settings = fusion_default_settings;
    settings.n_gps = SAMPLE_MAX_GPS + 1;
    EXPECT(fusion_init(&fusion, &settings) == EKF_REFUSED);
    settings = fusion_default_settings;
    settings.max_sigma = NAN;
    EXPECT(fusion_init(&fusion, &settings) == EKF_REFUSED);
    settings = fusion_default_settings;
    settings.noise.r[2] = 0.0;
    EXPECT(fusion_init(&fusion, &settings) == EKF_REFUSED);
}

int main(void)
{
    refuses_settings_out_of_range();
    for (int n_gps = 0; n_gps <= SAMPLE_MAX_GPS; n_gps += n_gps == 3 ? 5 : 1) {
        survives_anything(FUSION_CNW_EKF, n_gps, 20000);
        survives_anything(FUSION_CNW3, n_gps, 20000);
        survives_anything(FUSION_EKF_CI, n_gps, 20000);
    }
    return expect_verdict("fusion");
}
