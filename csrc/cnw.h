/* Classification and weighing (the card's CnW): how much each GPS counts, and how headings are weighed together. */
#ifndef CNW_H
#define CNW_H

enum { CNW_BAD = 0, CNW_GOOD = 1, CNW_EXCELLENT = 2, CNW_IDEAL = 3 };

/* Stage 1: weight of a receiver from its fix quality (GGA field 6) and HDOP (Code 3 of the 2019 paper). An HDOP that is
 * NaN or not positive is bad. */
int cnw_stage1(int fix_quality, double hdop);

/* Stage 2: GPSEC_yaw ((2) of both papers, across north): n GPS headings, NaN where missing, with their weights, and the
 * compass' true heading (NaN: none); rad, result in (-pi, pi] or NaN. A heading that is missing counts with weight 0. */
double cnw_stage2(const double *heading, const double *weight, int n, double compass);

/* Stage 3: weighted circular mean of the filters' headings ((13) of the 2019 paper); with all weights zero their plain
 * mean. Missing headings are left out; NaN when nothing is left or the directions cancel. */
double cnw_stage3(const double *heading, const double *weight, int n);

#endif
