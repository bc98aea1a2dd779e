/*
 * What the C core costs, sample by sample: feeds decoded samples to one method and prints how many there were of each
 * kind; under qemu-arm with count_insns.c also what each kind took (mean and most of one call).
 *
 *     core_load METHOD VARIATION_DEG SAMPLES [DIR]
 *
 * METHOD is a fusion_method_t; SAMPLES a file of sample_t; DIR where count_insns.c has its counters. Under callgrind
 * the functions imu_tick, gps_epoch, compass_reading and grid_row carry the costs.
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "angle.h"
#include "counters.h"
#include "fusion.h"

#define APART __attribute__((noinline, noclone))

static fusion_t fusion;
static estimate_t row;

static APART void imu_tick(const sample_t *sample)
{
    (void)fusion_feed(&fusion, sample);
}

static APART void gps_epoch(const sample_t *sample)
{
    (void)fusion_feed(&fusion, sample);
}

static APART void compass_reading(const sample_t *sample)
{
    (void)fusion_feed(&fusion, sample);
}

static APART int grid_row(const sample_t *sample)
{
    return fusion_next_row(&fusion, sample->t_us, &row);
}

enum { IMU_TICK = 0, GPS_EPOCH = 1, COMPASS_READING = 2, GRID_ROW = 3, KINDS = 4 };
static const char *const names[KINDS] = {"imu_tick", "gps_epoch", "compass_reading", "grid_row"};

typedef struct {
    uint64_t calls, most, sums[COUNTERS];
} cost_t;

static cost_t costs[KINDS];
static const volatile uint64_t *counters;
static uint64_t before[COUNTERS], overhead[COUNTERS];

static APART void begin(void)
{
    for (int i = 0; counters != NULL && i < COUNTERS; i++)
        before[i] = counters[i];
}

static APART void end(cost_t *cost)
{
    uint64_t now[COUNTERS];
    for (int i = 0; counters != NULL && i < COUNTERS; i++)
        now[i] = counters[i];
    cost->calls++;
    for (int i = 0; counters != NULL && i < COUNTERS; i++) {
        uint64_t taken = now[i] - before[i] - overhead[i];
        cost->sums[i] += taken;
        if (i == ALL && taken > cost->most)
            cost->most = taken;
    }
}

/* The counters of this process; what reading them costs is found out once. */
static int open_counters(const char *folder)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%d", folder, (int)getpid());
    int fd = open(path, O_RDONLY);
    if (fd < 0)
        return 0;
    void *map = mmap(NULL, COUNTERS * sizeof(uint64_t), PROT_READ, MAP_SHARED, fd, 0);
    close(fd);
    if (map == MAP_FAILED)
        return 0;
    counters = map;
    cost_t nothing = {0};
    begin();
    end(&nothing);
    memcpy(overhead, nothing.sums, sizeof overhead);
    return 1;
}

int main(int argc, char **argv)
{
    fusion_settings_t settings = fusion_default_settings;
    FILE *file = argc >= 4 ? fopen(argv[3], "rb") : NULL;
    if (file == NULL || (argc > 4 && !open_counters(argv[4]))) {
        fprintf(stderr, "core_load: usage: core_load METHOD VARIATION_DEG SAMPLES [DIR of count_insns]\n");
        return 2;
    }
    settings.method = (fusion_method_t)atoi(argv[1]);
    settings.variation = atof(argv[2]) * ANGLE_DEGREE;
    if (fusion_init(&fusion, &settings) != EKF_ACCEPTED)
        return 1;
    sample_t sample;
    while (fread(&sample, sizeof sample, 1, file) == 1) {
        for (int written = 1; written != 0;) {
            begin();
            written = grid_row(&sample);
            if (written)
                end(&costs[GRID_ROW]);
        }
        int kind = sample.source == SAMPLE_IMU       ? IMU_TICK
                   : sample.source == SAMPLE_COMPASS ? COMPASS_READING
                                                     : GPS_EPOCH;
        begin();
        if (kind == IMU_TICK)
            imu_tick(&sample);
        else if (kind == COMPASS_READING)
            compass_reading(&sample);
        else
            gps_epoch(&sample);
        end(&costs[kind]);
    }
    fclose(file);
    for (int kind = 0; kind < KINDS; kind++) {
        printf("%s %" PRIu64 " %" PRIu64, names[kind], costs[kind].calls, costs[kind].most);
        for (int i = 0; i < COUNTERS; i++)
            printf(" %" PRIu64, costs[kind].sums[i]);
        printf("\n");
    }
    return 0;
}
