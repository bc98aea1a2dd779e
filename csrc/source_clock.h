/* Whether a sensor is still talking: fresh until three of its periods, and at least a second, have passed in silence, or
 * until it is known to be lost. */
#ifndef SOURCE_CLOCK_H
#define SOURCE_CLOCK_H

#ifndef TINYEKF_CDEF
#include <stdint.h>
#endif

#define SOURCE_NEVER INT64_MIN

typedef struct {
    int64_t last_us;     /* stamp of its last sample; SOURCE_NEVER before the first */
    int64_t interval_us; /* between its last two stamps, at most 2 s */
    int64_t period_us;   /* the longer of its last two intervals */
    int stopped;         /* its poll task is off */
    int lost;            /* it is gone, or what it says is not so, until it is noted again */
} source_clock_t;

void source_clock_reset(source_clock_t *clock);

/* Notes a sample. Those that share a stamp came in one read, and tell no interval. */
void source_clock_tick(source_clock_t *clock, int64_t t_us);

/* Knows it to be lost until the next sample that is noted. */
void source_clock_lose(source_clock_t *clock);

/* How long a silence it is allowed. */
int64_t source_clock_patience_us(const source_clock_t *clock);

int source_clock_is_fresh(const source_clock_t *clock, int64_t now_us);

/* Seconds from one stamp to a later one. INFINITY when there was none. */
double source_seconds_since(int64_t then_us, int64_t now_us);

#endif
