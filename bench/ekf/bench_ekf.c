/* How long one prediction and update of the heading filter takes, against TinyEKF's algorithm in the same run, and which of
 * them survives the lock-up cases. Contenders take turns; each is given its shortest turn. */
#define _POSIX_C_SOURCE 199309L

#include <math.h>
#include <stdio.h>
#include <time.h>

#include "heading_model.h"
#include "lock_up.h"
#include "tinyekf.h"

enum { COURSE = 4096, TURNS = 40, COURSES_A_TURN = 20 };

/* The boat's course: 2 m/s, the heading swinging between -1 and 1 rad; how it turns, and what is measured of it, with errors
 * of a receiver's and a compass's size. */
static double course_z[COURSE][3];
static double course_rate[COURSE];

static const double u = 2.0;
static const double dt = 0.1;
static const double q[3] = {0.01, 0.01, 0.003};
static const double r[3] = {0.3, 0.07, 1e-5};

static const ekf_real x0[3] = {0, 0, 0};
static const ekf_real P0[3][3] = {{10, 0, 0}, {0, 10, 0}, {0, 0, 1}};

static ekf_t ours;
static tinyekf_generic_t generic;
static tinyekf_static_t constant;

static void chart_course(void)
{
    double north = 0.0;
    double east = 0.0;
    for (int i = 0; i < COURSE; i++) {
        const double psi = sin(0.01 * i);
        course_rate[i] = 0.1 * cos(0.01 * i);
        north += dt * u * cos(psi);
        east += dt * u * sin(psi);
        course_z[i][0] = north + 0.5 * sin(1.7 * i);
        course_z[i][1] = east + 0.3 * sin(2.9 * i);
        course_z[i][2] = psi + 0.003 * sin(2.3 * i);
    }
}

static void start_all(void)
{
    ekf_init(&ours, x0, P0, 1u << HEADING_PSI);
    generic = (tinyekf_generic_t){.n = TINYEKF_N, .m = TINYEKF_M, .P = {10, 0, 0, 0, 10, 0, 0, 0, 1}};
    constant = (tinyekf_static_t){.P = {10, 0, 0, 0, 10, 0, 0, 0, 1}};
}

static void take_both(void)
{
    for (int i = 0; i < COURSE; i++) {
        heading_model_predict(&ours, u, 0.0, course_rate[i], dt, q);
        heading_model_update(&ours, course_z[i], 7u, r, 0.0, NULL);
    }
}

static void take_predict(void)
{
    for (int i = 0; i < COURSE; i++) {
        heading_model_predict(&ours, u, 0.0, course_rate[i], dt, q);
    }
}

static void take_update(void)
{
    for (int i = 0; i < COURSE; i++) {
        heading_model_update(&ours, course_z[i], 7u, r, 0.0, NULL);
    }
}

/* The same step through ekf_predict and ekf_update, which know nothing of the model. */
static void take_any_model(void)
{
    for (int i = 0; i < COURSE; i++) {
        const double north = dt * u * cos(ours.x[2]);
        const double east = dt * u * sin(ours.x[2]);
        const ekf_real fx[3] = {ours.x[0] + north, ours.x[1] + east, ours.x[2] + dt * course_rate[i]};
        const ekf_real F[3][3] = {{1, 0, -east}, {0, 1, north}, {0, 0, 1}};
        const ekf_real Q[3][3] = {{q[0] * dt, 0, 0}, {0, q[1] * dt, 0}, {0, 0, q[2] * dt}};
        ekf_predict(&ours, fx, F, Q);
        ekf_measurement_t m; /* entry by entry, as in heading_model.c */
        m.rows = 7u;
        m.angle_rows = 4u;
        m.gate = 0;
        for (int j = 0; j < 3; j++) {
            m.z[j] = course_z[i][j];
            m.hx[j] = ours.x[j];
            for (int k = 0; k < 3; k++) {
                m.H[j][k] = j == k;
                m.R[j][k] = j == k ? r[j] : 0;
            }
        }
        ekf_update(&ours, &m, NULL);
    }
}

static void take_generic(void)
{
    for (int i = 0; i < COURSE; i++) {
        tinyekf_generic_boat(&generic, u, course_rate[i], dt, q, course_z[i], r);
    }
}

static void take_static(void)
{
    for (int i = 0; i < COURSE; i++) {
        tinyekf_static_boat(&constant, u, course_rate[i], dt, q, course_z[i], r);
    }
}

typedef struct {
    const char *name;
    void (*take)(void);
    double best_ns; /* a step */
} contender_t;

static double seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void race(contender_t *contenders, int count)
{
    for (int turn = 0; turn < TURNS; turn++) {
        for (int i = 0; i < count; i++) {
            start_all();
            const double begun = seconds();
            for (int k = 0; k < COURSES_A_TURN; k++) {
                contenders[i].take();
            }
            const double ns = 1e9 * (seconds() - begun) / (COURSE * COURSES_A_TURN);
            if (!turn || ns < contenders[i].best_ns) {
                contenders[i].best_ns = ns;
            }
        }
    }
}

static double disagreement(const double *a, const double *b, int count)
{
    double worst = 0.0;
    for (int i = 0; i < count; i++) {
        const double difference = fabs(a[i] - b[i]) / fmax(1e-3, fabs(b[i]));
        worst = difference <= worst ? worst : difference; /* NaN is kept */
    }
    return worst;
}

/* All filters over one course: they compute the same thing, or the race says nothing. */
static void print_agreement(void)
{
    start_all();
    take_both();
    take_generic();
    take_static();
    const double *P = &ours.P[0][0];
    printf("Largest relative difference after %d steps: x %.0e and %.0e, P %.0e and %.0e\n\n", COURSE,
           disagreement(generic.x, ours.x, 3), disagreement(constant.x, ours.x, 3), disagreement(generic.P, P, 9),
           disagreement(constant.P, P, 9));
}

static void print_lock_up(const char *name, int (*fails_at)(const lock_up_case_t *))
{
    printf("  %-34s", name);
    for (int i = 0; i < LOCK_UP_CASES; i++) {
        const int step = fails_at(&lock_up_cases[i]);
        if (step < LOCK_UP_STEPS) {
            printf(" %9d", step);
        } else {
            printf(" %9s", "none");
        }
    }
    printf("\n");
}

int main(void)
{
    contender_t contenders[] = {
        {"ours: predict + update", take_both, 0.0},
        {"ours: predict", take_predict, 0.0},
        {"ours: update", take_update, 0.0},
        {"ours: any model, through ekf.h", take_any_model, 0.0},
        {"TinyEKF, sizes at run time", take_generic, 0.0},
        {"TinyEKF, header only", take_static, 0.0},
    };
    const int count = (int)(sizeof contenders / sizeof *contenders);
    chart_course();
    print_agreement();
    race(contenders, count);
    printf("One step of the boat, 3 states, 3 rows, double; shortest of %d turns\n", TURNS);
    for (int i = 0; i < count; i++) {
        printf("  %-34s %7.1f ns   %5.2f\n", contenders[i].name, contenders[i].best_ns,
               contenders[i].best_ns / contenders[0].best_ns);
    }
    printf("\nStep of %d at which the filter first fails, by P0\n  %-34s", LOCK_UP_STEPS, "");
    for (int i = 0; i < LOCK_UP_CASES; i++) {
        printf(" %9.0e", lock_up_cases[i].p0);
    }
    printf("\n");
    print_lock_up("ours", lock_up_ours);
    print_lock_up("TinyEKF, sizes at run time", lock_up_tinyekf_generic);
    print_lock_up("TinyEKF, header only", lock_up_tinyekf_static);
    return 0;
}
