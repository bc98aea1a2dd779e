#include "source_clock.h"

#include <math.h>

static const int64_t usual_period_us = 100000;
static const int64_t longest_period_us = 2000000;
static const int64_t least_patience_us = 1000000;

void source_clock_reset(source_clock_t *clock)
{
    *clock = (source_clock_t){.last_us = SOURCE_NEVER, .interval_us = usual_period_us, .period_us = usual_period_us};
}

void source_clock_tick(source_clock_t *clock, int64_t t_us)
{
    clock->lost = 0;
    if (clock->last_us != SOURCE_NEVER && t_us > clock->last_us) {
        const int64_t since = t_us - clock->last_us;
        const int64_t interval = since < longest_period_us ? since : longest_period_us;
        clock->period_us = interval > clock->interval_us ? interval : clock->interval_us;
        clock->interval_us = interval;
    }
    clock->last_us = t_us;
}

void source_clock_lose(source_clock_t *clock)
{
    clock->lost = 1;
}

int64_t source_clock_patience_us(const source_clock_t *clock)
{
    const int64_t patience = 3 * clock->period_us;
    return patience > least_patience_us ? patience : least_patience_us;
}

int source_clock_is_fresh(const source_clock_t *clock, int64_t now_us)
{
    return !clock->stopped && !clock->lost && clock->last_us != SOURCE_NEVER &&
           now_us - clock->last_us <= source_clock_patience_us(clock);
}

double source_seconds_since(int64_t then_us, int64_t now_us)
{
    return then_us == SOURCE_NEVER ? INFINITY : (double)(now_us - then_us) * 1e-6;
}
