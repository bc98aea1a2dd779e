/* What the fusion says at a moment: the methods' ways from the filters to one heading, and how far to trust it. */
#include <math.h>
#include <stddef.h>

#include "angle.h"
#include "cnw.h"
#include "covariance_intersection.h"
#include "fusion.h"

static const double position_lasts_s = 60.0; /* after the last fix */

/* The running filters, predicted to the moment, with the weights of their receivers. */
typedef struct {
    ekf_t ekf[SAMPLE_MAX_GPS];
    int has_position[SAMPLE_MAX_GPS];
    double weight[SAMPLE_MAX_GPS];
    const double *arm[SAMPLE_MAX_GPS]; /* where its antenna is */
    int n;
} crew_t;

/* One answer of a method. */
typedef struct {
    double heading; /* rad; NaN: none */
    double sigma;   /* rad */
    double north;   /* m; NaN: none */
    double east;
    double arm[2]; /* m: the place of this position aboard, ahead and to starboard */
} answer_t;

static void gather(const fusion_t *fusion, int64_t t_us, crew_t *crew, estimate_t *estimate)
{
    crew->n = 0;
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        if (!fusion->filter[i].running || !fusion_uses_filter(fusion, i)) {
            continue;
        }
        heading_filter_t filter = fusion->filter[i];
        heading_filter_advance(&filter, t_us, receiver_speed(&fusion->gps[i], t_us), fusion_rate(fusion, t_us),
                               &fusion->settings.noise);
        crew->ekf[crew->n] = filter.ekf;
        crew->has_position[crew->n] = filter.has_position;
        crew->weight[crew->n] = receiver_weight(&fusion->gps[i], t_us);
        crew->arm[crew->n] = fusion->settings.adaptive.arm[i];
        crew->n++;
        estimate->ekf_deg[i] = angle_to_bearing_deg((double)filter.ekf.x[HEADING_PSI]);
    }
}

static answer_t of_one(const ekf_t *ekf, int has_position)
{
    return (answer_t){
        .heading = (double)ekf->x[HEADING_PSI],
        .sigma = sqrt((double)ekf->P[HEADING_PSI][HEADING_PSI]),
        .north = has_position ? (double)ekf->x[HEADING_NORTH] : NAN,
        .east = has_position ? (double)ekf->x[HEADING_EAST] : NAN,
    };
}

/* Stage 3. */
static answer_t weighed(const crew_t *crew)
{
    double heading[SAMPLE_MAX_GPS];
    double sum_weight = 0.0;
    for (int i = 0; i < crew->n; i++) {
        heading[i] = (double)crew->ekf[i].x[HEADING_PSI];
        sum_weight += crew->weight[i];
    }
    double all = 0.0;
    double placed = 0.0;
    double placed_weight = 0.0;
    answer_t answer = {.heading = cnw_stage3(heading, crew->weight, crew->n)};
    for (int i = 0; i < crew->n; i++) {
        const ekf_t *ekf = &crew->ekf[i];
        const double weight = sum_weight > 0.0 ? crew->weight[i] : 1.0;
        all += weight;
        answer.sigma += weight * sqrt((double)ekf->P[HEADING_PSI][HEADING_PSI]);
        placed_weight += crew->has_position[i] ? crew->weight[i] : 0.0;
    }
    answer.sigma /= all;
    for (int i = 0; i < crew->n; i++) {
        if (crew->has_position[i]) {
            const double weight = placed_weight > 0.0 ? crew->weight[i] : 1.0;
            placed += weight;
            answer.north += weight * (double)crew->ekf[i].x[HEADING_NORTH];
            answer.east += weight * (double)crew->ekf[i].x[HEADING_EAST];
            answer.arm[0] += weight * crew->arm[i][0];
            answer.arm[1] += weight * crew->arm[i][1];
        }
    }
    answer.north /= placed; /* 0 / 0: no position is NaN */
    answer.east /= placed;
    answer.arm[0] /= placed;
    answer.arm[1] /= placed;
    return answer;
}

/* Covariance intersection of neighbours until one is left: of three, as the predecessor did, CI(CI(1,2), CI(2,3)). */
static answer_t intersected(const crew_t *crew)
{
    ekf_t left[SAMPLE_MAX_GPS];
    int n = 0;
    int placed = 0;
    for (int i = 0; i < crew->n; i++) {
        placed |= crew->has_position[i];
    }
    for (int i = 0; i < crew->n; i++) {
        if (crew->has_position[i] == placed) {
            left[n++] = crew->ekf[i];
        }
    }
    for (; n > 1; n--) {
        for (int i = 0; i + 1 < n; i++) {
            if (covariance_intersection(&left[i], &left[i + 1], CI_MINIMISE_DET, &left[i], NULL) != EKF_ACCEPTED) {
                return (answer_t){.heading = NAN, .north = NAN, .east = NAN};
            }
        }
    }
    return of_one(&left[0], placed);
}

static answer_t answer_of(const fusion_t *fusion, const crew_t *crew)
{
    if (crew->n == 0) {
        return (answer_t){.heading = NAN, .sigma = NAN, .north = NAN, .east = NAN};
    }
    if (fusion->settings.method == FUSION_CNW_EKF || fusion->stopped[FUSION_STAGE3]) {
        answer_t answer = of_one(&crew->ekf[0], crew->has_position[0]);
        answer.arm[0] = crew->arm[0][0];
        answer.arm[1] = crew->arm[0][1];
        return answer;
    }
    return fusion->settings.method == FUSION_EKF_CI ? intersected(crew) : weighed(crew);
}

/* Adaptive's heading in place of the filters', and the position of the boat's reference point in place of the antennas'. */
static void adapt(const fusion_t *fusion, int64_t t_us, answer_t *answer)
{
    if (!adaptive_heading(&fusion->adaptive, t_us, &answer->heading, &answer->sigma)) {
        answer->heading = NAN;
        return;
    }
    const double c = cos(answer->heading);
    const double s = sin(answer->heading);
    answer->north -= c * answer->arm[0] - s * answer->arm[1];
    answer->east -= s * answer->arm[0] + c * answer->arm[1];
}

static fusion_mode_t heading_mode(const fusion_t *fusion, int64_t t_us, const answer_t *answer)
{
    const int compass = source_clock_is_fresh(&fusion->compass_clock, t_us);
    const int imu = source_clock_is_fresh(&fusion->imu_clock, t_us);
    int aboard = 0;
    int tracks = 0;
    int fixes = 0;
    double weights = 0.0;
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        aboard += fusion_has_gps(fusion, i);
        tracks += receiver_carries_heading(&fusion->gps[i], t_us);
        fixes += receiver_has_fix(&fusion->gps[i], t_us);
        weights += receiver_weight(&fusion->gps[i], t_us);
    }
    if (!isfinite(answer->heading) || !(answer->sigma <= fusion->settings.max_sigma) || !(tracks || compass || imu)) {
        return FUSION_INVALID;
    }
    if (!tracks && !compass) {
        return FUSION_DEAD_RECKONING;
    }
    int stopped = 0;
    for (int task = 0; task < FUSION_EKF1 + fusion->settings.n_gps; task++) {
        stopped |= fusion->stopped[task];
    }
    const int all_there =
        fixes == aboard && (compass || !fusion->settings.has_compass) && (imu || !fusion->settings.has_imu);
    const int unweighed = aboard > 0 && !(weights > 0.0);
    return all_there && !stopped && !unweighed ? FUSION_OK : FUSION_DEGRADED;
}

static fusion_mode_t position_mode(const fusion_t *fusion, int64_t t_us, const answer_t *answer)
{
    if (!isfinite(answer->north)) {
        return FUSION_INVALID;
    }
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        if (fusion_uses_filter(fusion, i) && fusion->filter[i].has_position &&
            receiver_has_fix(&fusion->gps[i], t_us)) {
            return FUSION_GPS;
        }
    }
    return source_seconds_since(fusion->fix_us, t_us) <= position_lasts_s ? FUSION_DEAD_RECKONING : FUSION_INVALID;
}

void fusion_estimate(const fusion_t *fusion, int64_t t_us, estimate_t *estimate)
{
    *estimate = (estimate_t){.t_us = t_us,
                             .heading_deg = NAN,
                             .heading_sigma_deg = NAN,
                             .rate_of_turn_dps = NAN,
                             .lat_deg = NAN,
                             .lon_deg = NAN};
    for (int i = 0; i < SAMPLE_MAX_GPS; i++) {
        const int configured = fusion_has_gps(fusion, i);
        const double azimuth = configured ? receiver_azimuth(&fusion->gps[i], t_us) : NAN;
        estimate->weight[i] = configured ? receiver_weight(&fusion->gps[i], t_us) : NAN;
        estimate->faz_deg[i] = angle_to_bearing_deg(azimuth);
        estimate->ekf_deg[i] = NAN;
    }
    estimate->gpsec_deg = angle_to_bearing_deg(fusion_gpsec(fusion, t_us));
    if (source_clock_is_fresh(&fusion->imu_clock, t_us)) {
        estimate->rate_of_turn_dps = fusion->rate / ANGLE_DEGREE;
    }

    crew_t crew;
    gather(fusion, t_us, &crew, estimate);
    answer_t answer = answer_of(fusion, &crew);
    if (fusion->settings.method == FUSION_ADAPTIVE) {
        adapt(fusion, t_us, &answer);
    }
    estimate->mode = (int32_t)heading_mode(fusion, t_us, &answer);
    estimate->pos_mode = (int32_t)position_mode(fusion, t_us, &answer);
    if (estimate->mode != FUSION_INVALID) {
        estimate->heading_deg = angle_to_bearing_deg(answer.heading);
        estimate->heading_sigma_deg = answer.sigma / ANGLE_DEGREE;
    }
    if (estimate->pos_mode != FUSION_INVALID) {
        double lat;
        double lon;
        local_frame_to_position(&fusion->frame, answer.north, answer.east, &lat, &lon);
        estimate->lat_deg = lat / ANGLE_DEGREE;
        estimate->lon_deg = lon / ANGLE_DEGREE;
    }
}

double fusion_mean_nis(const fusion_t *fusion)
{
    if (fusion->settings.method == FUSION_ADAPTIVE) {
        return fusion->adaptive.nis / fusion->adaptive.headings; /* 0 / 0: none is NaN */
    }
    double nis = 0.0;
    int headings = 0;
    for (int i = 0; i < fusion->settings.n_gps; i++) {
        nis += fusion->filter[i].nis;
        headings += fusion->filter[i].headings;
    }
    return nis / headings;
}

int fusion_next_row(fusion_t *fusion, int64_t t_us, estimate_t *row)
{
    if (fusion->now_us == SOURCE_NEVER || fusion->next_row_us >= t_us) {
        return 0;
    }
    fusion_estimate(fusion, fusion->next_row_us, row);
    fusion->next_row_us += FUSION_GRID_US;
    return 1;
}
