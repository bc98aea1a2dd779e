/* Times one epoch of the vehicle's methods and one 4 x 10 predict and update: nanoseconds each. Build: see README.md. */
#define _POSIX_C_SOURCE 199309L

#include <math.h>
#include <stdio.h>
#include <time.h>

#include "vehicle.h"

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* One predict and update of ten rows, as the paper's filter has them. */
static double filter_ns(int n)
{
    const ekf_real x0[4] = {0, 0, 10, 0};
    const ekf_real P0[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    const ekf_real F[4][4] = {{1, 0, 0.1, 0}, {0, 1, 0, 0.1}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    const ekf_real Q[4][4] = {{1e-4, 0, 0, 0}, {0, 1e-4, 0, 0}, {0, 0, 1e-2, 0}, {0, 0, 0, 1e-2}};
    vehicle_ekf_t ekf;
    vehicle_ekf_measurement_t m = {.rows = 1023u, .angle_rows = 60u};
    vehicle_ekf_init(&ekf, x0, P0, 0);
    m.H[0][0] = m.H[1][1] = 1;
    for (int i = 2; i < 10; i++) {
        const int turn = i < 6;
        m.H[i][0] = turn ? -0.3 : 0.8;
        m.H[i][1] = turn ? 0.8 : 0.3;
        m.H[i][2] = turn ? -0.03 : 0.08;
        m.H[i][3] = turn ? 0.08 : 0.03;
    }
    for (int i = 0; i < 10; i++) {
        m.R[i][i] = 0.01;
    }
    const double start = now_s();
    for (int k = 0; k < n; k++) {
        const ekf_real fx[4] = {ekf.x[0] + 0.1 * ekf.x[2], ekf.x[1] + 0.1 * ekf.x[3], ekf.x[2], ekf.x[3]};
        vehicle_ekf_predict(&ekf, fx, F, Q);
        m.z[0] = m.hx[0] = ekf.x[0];
        m.z[1] = m.hx[1] = ekf.x[1];
        vehicle_ekf_update(&ekf, &m, NULL);
    }
    return (now_s() - start) / n * 1e9;
}

enum { EPOCHS = 100000 };
static vehicle_epoch_t epochs[EPOCHS];
static vehicle_estimate_t estimates[EPOCHS];
static vehicle_t vehicle;

static double epoch_ns(int method)
{
    vehicle_options_t o = {.method = method,
                           .accel_sigma_mps2 = {0.3, 0.3},
                           .q_ww = 1.0,
                           .along_density = 0.6,
                           .lateral_density = 1.6,
                           .position_walk = 0.01,
                           .gate_gps = 13.8,
                           .gate_row = 10.8,
                           .reaccept_s = 3.0,
                           .standstill_mps = 0.1,
                           .start_sigma_rad = 0.05,
                           .start_azimuth_rad = 0.0,
                           .turn_threshold_rad = 0.01,
                           .turn_hysteresis = 0.5};
    for (int i = 0; i < VEHICLE_ROWS; i++) {
        o.white[i] = i < 2 ? 1.0 : 0.005;
    }
    double x = 0.0;
    double y = 0.0;
    double azimuth = 0.0;
    for (int i = 0; i < EPOCHS; i++) {
        const double turn = i / 100 % 2 ? 0.02 : 0.001;
        x += cos(azimuth + turn / 2);
        y += sin(azimuth + turn / 2);
        azimuth += turn;
        epochs[i] = (vehicle_epoch_t){.t_s = 0.1 * i,
                                      .gps_x_m = x,
                                      .gps_y_m = y,
                                      .gps_sigma_m = (double)NAN,
                                      .turn_rad = {turn, turn, turn, turn},
                                      .odo_m = 1.0,
                                      .oss_m = 1.0};
    }
    vehicle_init(&vehicle, &o);
    const double start = now_s();
    vehicle_run(&vehicle, epochs, estimates, EPOCHS);
    return (now_s() - start) / EPOCHS * 1e9;
}

int main(void)
{
    filter_ns(100000);
    printf("4 x 10 predict + update  %6.0f ns\n", filter_ns(1000000));
    printf("epoch kinematic-paper    %6.0f ns\n", epoch_ns(VEHICLE_KINEMATIC_PAPER));
    printf("epoch kinematic          %6.0f ns\n", epoch_ns(VEHICLE_KINEMATIC));
    printf("epoch lsa                %6.0f ns\n", epoch_ns(VEHICLE_LSA));
    return 0;
}
