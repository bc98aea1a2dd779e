/* What count_insns.c counts: 64-bit numbers in a file, in this order. */
#ifndef COUNTERS_H
#define COUNTERS_H

enum {
    ALL = 0,     /* instructions */
    DOUBLES = 1, /* operations in double precision, and their least and most cycles on a Cortex-A8's VFPLite */
    DOUBLES_LEAST = 2,
    DOUBLES_MOST = 3,
    SINGLES = 4, /* the same in single precision */
    SINGLES_LEAST = 5,
    SINGLES_MOST = 6,
    TRANSFERS = 7, /* from the floating-point unit to the core's registers or flags */
    OTHERS = 8,    /* floating-point instructions not known here: should be none that matter */
    COUNTERS = 9
};

#endif
