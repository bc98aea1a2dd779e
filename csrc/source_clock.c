#include "source_clock.h"

#include <math.h>

static const int64_t usual_period_us = 100000;
static const int64_t longest_period_us = 2000000;
static const int64_t least_patience_us = 1000000;

void source_clock_reset(source_clock_t *clock)
{
    *clock = (source_clock_t){.last_us = SOURCE_NEVER, .period_us = usual_period_us};
}

void source_clock_tick(source_clock_t *clock, int64_t t_us)
{
    if (clock->last_us != SOURCE_NEVER) {
        const int64_t interval = t_us - clock->last_us;
        clock->period_us = interval < longest_period_us ? interval : longest_period_us;
    }
    clock->last_us = t_us;
}

int64_t source_clock_patience_us(const source_clock_t *clock)
{
    const int64_t patience = 3 * clock->period_us;
    return patience > least_patience_us ? patience : least_patience_us;
}

int source_clock_is_fresh(const source_clock_t *clock, int64_t now_us)
{
    return !clock->stopped && clock->last_us != SOURCE_NEVER &&
           now_us - clock->last_us <= source_clock_patience_us(clock);
}

double source_seconds_since(int64_t then_us, int64_t now_us)
{
    return then_us == SOURCE_NEVER ? INFINITY : (double)(now_us - then_us) * 1e-6;
}
