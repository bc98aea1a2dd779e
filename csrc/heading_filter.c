#include "heading_filter.h"

#include <math.h>
#include <stddef.h>

#include "source_clock.h"

static const double position_expires_s = 10.0;
enum { POSITION_ROWS = 1u << HEADING_NORTH | 1u << HEADING_EAST, HEADING_ROW = 1u << HEADING_PSI };

void heading_filter_reset(heading_filter_t *filter)
{
    *filter = (heading_filter_t){.position_us = SOURCE_NEVER};
}

void heading_filter_advance(heading_filter_t *filter, int64_t t_us, double u, double r, const heading_noise_t *noise)
{
    if (!filter->running || t_us <= filter->t_us) {
        return;
    }
    heading_model_predict(&filter->ekf, u, 0.0, r, source_seconds_since(filter->t_us, t_us), noise->q);
    filter->t_us = t_us;
}

static ekf_status_t start(heading_filter_t *filter, int64_t t_us, const double z[3], int has_position,
                          const heading_noise_t *noise)
{
    const ekf_real x0[3] = {
        has_position ? (ekf_real)z[HEADING_NORTH] : 0,
        has_position ? (ekf_real)z[HEADING_EAST] : 0,
        (ekf_real)z[HEADING_PSI],
    };
    ekf_real P0[3][3] = {{0}};
    for (int i = 0; i < 3; i++) {
        P0[i][i] = (ekf_real)noise->p0[i];
    }
    const ekf_status_t status = ekf_init(&filter->ekf, x0, (const ekf_real(*)[3])P0, HEADING_ROW);
    filter->running = status == EKF_ACCEPTED;
    filter->has_position = has_position;
    filter->position_us = has_position ? t_us : SOURCE_NEVER;
    filter->t_us = t_us;
    return status;
}

/* Puts the filter at a position, uncorrelated with its heading. */
static void anchor(heading_filter_t *filter, const double z[3], const heading_noise_t *noise)
{
    ekf_real(*P)[3] = filter->ekf.P;
    for (int i = HEADING_NORTH; i <= HEADING_EAST; i++) {
        filter->ekf.x[i] = (ekf_real)z[i];
        for (int j = 0; j < 3; j++) {
            P[i][j] = P[j][i] = 0;
        }
        P[i][i] = (ekf_real)noise->p0[i];
    }
    filter->has_position = 1;
}

ekf_status_t heading_filter_measure(heading_filter_t *filter, int64_t t_us, const double z[3],
                                    const heading_noise_t *noise)
{
    const int has_heading = isfinite(z[HEADING_PSI]);
    const int has_position = isfinite(z[HEADING_NORTH] + z[HEADING_EAST]);
    if (!filter->running) {
        return has_heading ? start(filter, t_us, z, has_position, noise) : EKF_SKIPPED;
    }
    uint32_t rows = has_heading ? HEADING_ROW : 0;
    if (has_heading) {
        const double innovation = angle_wrap(z[HEADING_PSI] - (double)filter->ekf.x[HEADING_PSI]);
        filter->nis +=
            innovation * innovation / ((double)filter->ekf.P[HEADING_PSI][HEADING_PSI] + noise->r[HEADING_PSI]);
        filter->headings++;
    }
    if (has_position) {
        if (source_seconds_since(filter->position_us, t_us) > position_expires_s) {
            anchor(filter, z, noise);
        } else {
            rows |= POSITION_ROWS;
        }
        filter->position_us = t_us;
    }
    return heading_model_update(&filter->ekf, z, rows, noise->r, 0.0, NULL);
}

void heading_filter_turn(heading_filter_t *filter, double angle)
{
    if (filter->running) {
        ekf_real *psi = &filter->ekf.x[HEADING_PSI];
        *psi = (ekf_real)angle_wrap((double)*psi + angle);
    }
}
