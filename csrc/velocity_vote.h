/* One velocity over ground from what several receivers said within a tick: those that contradict the others are left out,
 * and for a while after. */
#ifndef VELOCITY_VOTE_H
#define VELOCITY_VOTE_H

#include "adaptive.h"

/* Writes the mean of the receivers that agree (all but its rate); 0 when none spoke. `dt`: length of the tick that ends
 * at t_us, s. */
int velocity_vote(adaptive_receiver_t *receivers, int n, int64_t t_us, double dt, adaptive_velocity_t *velocity);

#endif
