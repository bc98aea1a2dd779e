/* The lock-up cases of tests/c/test_ekf.c: a filter of heading, rate and bias, two headings whose noise swings together
 * over many decades. The step at which a filter fails, or LOCK_UP_STEPS. */
#ifndef LOCK_UP_H
#define LOCK_UP_H

enum { LOCK_UP_STEPS = 72000, LOCK_UP_CASES = 5 };

typedef struct {
    double p0, r_low, r_high;
} lock_up_case_t;

static const lock_up_case_t lock_up_cases[LOCK_UP_CASES] = {
    {1e0, 1e-2, 1e0}, {1e2, 1e-2, 1e4}, {1e3, 1e-4, 1e6}, {1e4, 1e-4, 1e8}, {1e6, 1e-6, 1e9},
};

int lock_up_ours(const lock_up_case_t *c);
int lock_up_tinyekf_generic(const lock_up_case_t *c);
int lock_up_tinyekf_static(const lock_up_case_t *c);

#endif
