#include "cnw.h"

#include <math.h>

#include "angle.h"

enum { MOST = 8 }; /* GPS receivers */

int cnw_stage1(int fix_quality, double hdop)
{
    int weight;
    if (!(hdop > 0.0)) {
        return CNW_BAD;
    } else if (hdop <= 2.0) {
        weight = CNW_IDEAL;
    } else if (hdop <= 5.0) {
        weight = CNW_EXCELLENT;
    } else if (hdop <= 10.0) {
        weight = CNW_GOOD;
    } else {
        return CNW_BAD;
    }
    if (fix_quality >= 2 && fix_quality <= 5) {
        return weight;
    }
    return fix_quality == 1 ? weight - 1 : CNW_BAD;
}

/* Weights of the headings that are there: their own, or 1 each when `equal`. Returns their sum. */
static double weights_of_present(const double *heading, const double *weight, int n, int equal, double *present)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++) {
        present[i] = 0.0;
        if (isfinite(heading[i]) && (equal || weight[i] > 0.0)) {
            present[i] = equal ? 1.0 : weight[i];
        }
        sum += present[i];
    }
    return sum;
}

double cnw_stage2(const double *heading, const double *weight, int n, double compass)
{
    double present[MOST];
    if (n > MOST) {
        return NAN;
    }
    const double sum = weights_of_present(heading, weight, n, 0, present);
    const double all_gps = angle_circular_mean(heading, present, n);
    if (isfinite(all_gps) && isfinite(compass)) {
        const double share = sum / (n * (double)CNW_IDEAL);
        return angle_wrap(compass + share * angle_wrap(all_gps - compass));
    }
    if (isfinite(all_gps)) {
        return all_gps;
    }
    if (isfinite(compass) || sum > 0.0) {
        return compass;
    }
    weights_of_present(heading, weight, n, 1, present);
    return angle_circular_mean(heading, present, n);
}

double cnw_stage3(const double *heading, const double *weight, int n)
{
    double present[MOST];
    if (n > MOST) {
        return NAN;
    }
    if (weights_of_present(heading, weight, n, 0, present) <= 0.0) {
        weights_of_present(heading, weight, n, 1, present);
    }
    return angle_circular_mean(heading, present, n);
}
