#include "yaw_history.h"

#include <stddef.h>

static const int64_t spacing_us = 8000;
static const int64_t live_us = 250000; /* a gyro silent for longer is lost: the boat may turn unseen */

void yaw_history_reset(yaw_history_t *history)
{
    history->n = 0;
    history->newest = 0;
}

void yaw_history_turn(yaw_history_t *history, int64_t t_us, double angle, double rate)
{
    int at = history->newest;
    const double before = history->n ? history->yaw[at] : 0.0;
    const int second = (at + YAW_HISTORY_LENGTH - 1) % YAW_HISTORY_LENGTH;
    if (history->n == 0) {
        history->n = 1;
    } else if (t_us == history->t_us[at]) { /* of one read with the newest: both are one turn */
    } else if (history->n == 1 || t_us - history->t_us[second] >= spacing_us) {
        at = (at + 1) % YAW_HISTORY_LENGTH;
        history->newest = at;
        history->n += history->n < YAW_HISTORY_LENGTH;
    } /* else the newest entry moves on */
    history->t_us[at] = t_us;
    history->yaw[at] = before + angle;
    history->rate[at] = rate;
}

int yaw_history_is_live(const yaw_history_t *history, int64_t t_us)
{
    return history->n > 0 && t_us - history->t_us[history->newest] <= live_us;
}

double yaw_history_at(const yaw_history_t *history, int64_t t_us, double *rate)
{
    if (history->n == 0) {
        if (rate) {
            *rate = 0.0;
        }
        return 0.0;
    }
    int at = history->newest;
    if (rate) {
        *rate = yaw_history_is_live(history, t_us) ? history->rate[at] : 0.0;
    }
    if (t_us >= history->t_us[at]) {
        const int64_t beyond = t_us - history->t_us[at];
        return history->yaw[at] + history->rate[at] * (double)(beyond < live_us ? beyond : live_us) * 1e-6;
    }
    for (int k = 1; k < history->n; k++) {
        const int before = (at + YAW_HISTORY_LENGTH - 1) % YAW_HISTORY_LENGTH;
        if (t_us >= history->t_us[before]) {
            const double share =
                (double)(t_us - history->t_us[before]) / (double)(history->t_us[at] - history->t_us[before]);
            if (rate) {
                *rate = history->rate[at];
            }
            return history->yaw[before] + share * (history->yaw[at] - history->yaw[before]);
        }
        at = before;
    }
    return history->yaw[at];
}
