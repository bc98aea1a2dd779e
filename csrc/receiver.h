/* One GPS receiver as the card sees it: its fix, its weight of stage 1 and its forward azimuth. */
#ifndef RECEIVER_H
#define RECEIVER_H

#include "sample.h"
#include "source_clock.h"

typedef struct {
    source_clock_t clock;
    int valid;      /* the last sample had a position and a fix */
    double lat_deg; /* of the last valid sample */
    double lon_deg;
    int64_t position_us; /* its stamp */
    double weight;       /* stage 1, of the last sample */
    double azimuth;      /* FAz, rad; NaN: none */
    int64_t azimuth_us;  /* stamp of the last one that was not NaN */
    double speed;        /* over ground, m/s, the last one given */
    int64_t speed_us;    /* its stamp */
} receiver_t;

void receiver_reset(receiver_t *receiver);

/* Takes an epoch of this receiver; with stage 1 stopped every valid fix weighs 1. */
void receiver_take(receiver_t *receiver, const sample_t *sample, int64_t t_us, int stage1_runs);

/* Fresh, and its last sample valid. */
int receiver_has_fix(const receiver_t *receiver, int64_t now_us);

/* It has a fix, and its track showed an azimuth not long ago: a position repeated now and then is no silence. */
int receiver_carries_heading(const receiver_t *receiver, int64_t now_us);

/* Weight, azimuth and speed as they count at a moment: 0, NaN and 0 when they are too old. */
double receiver_weight(const receiver_t *receiver, int64_t now_us);
double receiver_azimuth(const receiver_t *receiver, int64_t now_us);
double receiver_speed(const receiver_t *receiver, int64_t now_us);

#endif
