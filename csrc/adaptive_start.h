/* How the adaptive method begins, and begins again when its gyro or its compass turns out not to be there: for adaptive.c
 * alone. */
#ifndef ADAPTIVE_START_H
#define ADAPTIVE_START_H

#include "adaptive.h"

/* A start and a turn tell of a current for so long; on a straight course the two likelihoods only drift apart. */
#define ADAPTIVE_EVIDENCE_US 30000000

/* Logarithm of the odds of a current, before anything is measured. */
double adaptive_odds_of_current(const adaptive_settings_t *settings);

/* Begins with the compass, else with the course of a boat that moves. Returns whether it has. */
int adaptive_start(adaptive_t *adaptive, int64_t t_us, const adaptive_bearing_t *bearing,
                   const adaptive_velocity_t *velocity);

/* The bias' state is the rate of turn while there is no gyro: changes over when the gyro falls silent or speaks again. */
void adaptive_hear_gyro(adaptive_t *adaptive, int64_t t_us);

/* Goes back to what was kept, but for the heading, which has to start anew. */
void adaptive_go_back(adaptive_t *adaptive, int64_t t_us);

#endif
