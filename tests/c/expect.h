/* What the C tests share: a check that says where it failed, and a closing line. */
#ifndef EXPECT_H
#define EXPECT_H

#include <stdio.h>

static int expect_failures = 0;
static int expect_checks = 0;

#define EXPECT(condition)                                                                                              \
    do {                                                                                                               \
        expect_checks++;                                                                                               \
        if (!(condition)) {                                                                                            \
            expect_failures++;                                                                                         \
            printf("%s:%d: %s: not so: %s\n", __FILE__, __LINE__, __func__, #condition);                               \
        }                                                                                                              \
    } while (0)

#define EXPECT_NEAR(a, b, tolerance) EXPECT(fabs((double)(a) - (double)(b)) <= (tolerance))

static int expect_verdict(const char *name)
{
    printf("%s: %d checks, %d failed\n", name, expect_checks, expect_failures);
    return expect_failures > 0;
}

#endif
