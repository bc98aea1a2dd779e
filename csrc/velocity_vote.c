#include "velocity_vote.h"

#include <math.h>

static const double contradiction = 3.5;    /* sigma between two receivers */
static const double waves = 0.12;           /* m/s: antennas apart move apart */
static const double suspicion_mps = 1000.0; /* so far from all others is one that is suspected */
static const double tie_break = 1e-3;
static const int64_t suspicion_us = 4000000;

typedef struct {
    double north;
    double east;
    double variance;
    adaptive_receiver_t *receiver;
} vote_t;

/* The vote with the least distance to all others: as a median, but of vectors. No vote counts more than another here,
 * lest one that lies with a good HDOP outvote two; of two alone, the one that claims to be better. */
static const vote_t *most_central(const vote_t *votes, int n, int64_t t_us)
{
    const vote_t *best = &votes[0];
    double least = INFINITY;
    for (int i = 0; i < n; i++) {
        double distance = votes[i].receiver->suspect_until_us > t_us ? suspicion_mps : 0.0;
        distance += votes[i].variance * tie_break;
        for (int j = 0; j < n; j++) {
            distance += hypot(votes[i].north - votes[j].north, votes[i].east - votes[j].east);
        }
        if (distance < least) {
            least = distance;
            best = &votes[i];
        }
    }
    return best;
}

int velocity_vote(adaptive_receiver_t *receivers, int n, int64_t t_us, double dt, adaptive_velocity_t *velocity)
{
    vote_t votes[SAMPLE_MAX_GPS];
    int count = 0;
    for (int i = 0; i < n && i < SAMPLE_MAX_GPS; i++) {
        adaptive_receiver_t *sum = &receivers[i];
        if (sum->n > 0) {
            votes[count++] = (vote_t){sum->north / sum->n, sum->east / sum->n, sum->variance / sum->n, sum};
        }
    }
    if (count == 0) {
        return 0;
    }
    const vote_t *centre = most_central(votes, count, t_us);
    double information = 0.0;
    *velocity = (adaptive_velocity_t){.age = dt};
    double north = 0.0, east = 0.0, yaw = 0.0, age = 0.0;
    for (int i = 0; i < count; i++) {
        adaptive_receiver_t *sum = votes[i].receiver;
        const double apart = hypot(votes[i].north - centre->north, votes[i].east - centre->east);
        const double allowed = contradiction * sqrt(votes[i].variance + centre->variance + waves * waves);
        if (apart > allowed) {
            sum->suspect_until_us = t_us + suspicion_us;
        }
        if (&votes[i] != centre && sum->suspect_until_us > t_us) {
            continue;
        }
        const double weight = 1.0 / votes[i].variance;
        information += weight;
        north += weight * votes[i].north;
        east += weight * votes[i].east;
        yaw += weight * sum->yaw / sum->n;
        age += weight * sum->age / sum->n;
    }
    velocity->north = north / information;
    velocity->east = east / information;
    velocity->yaw = yaw / information;
    velocity->age = dt - age / information;
    velocity->variance = 1.0 / information;
    return 1;
}
