/* Contacts as instants. */
#ifndef CONFLICTDB_INSTANTS_H
#define CONFLICTDB_INSTANTS_H

#include <math.h>
#include <stdbool.h>

#include "kernel.h"

typedef struct {
    int64_t start_us, end_us;
} Time;

static inline bool is_endless(Time time) {
    return time.start_us == KERNEL_MINUS_INFINITY_US || time.end_us == KERNEL_INFINITY_US;
}

/* Microseconds between two instants. */
static inline double us_between(int64_t from, int64_t to) { return (double)(int64_t)((uint64_t)to - (uint64_t)from); }

/* Seconds from the start of a shared time as instants in it, rounded outward to the microsecond (merge.c). */
Time instants_of(double start_s, double end_s, Time shared);

#endif
