/* Heights of two pieces, linear in time along their legs. */
#ifndef CONFLICTDB_HEIGHTS_H
#define CONFLICTDB_HEIGHTS_H

#include <stdbool.h>

#include "kernel.h"
#include "narrow/differences.h"
#include "narrow/instants.h"

/* Check that required arrays are given, and that rows of pieces are in range. */
KernelStatus heights_check(const KernelHeights *pieces, const int64_t *a, const int64_t *b, int64_t count);

/* Whether the heights of two pieces overlap whenever both exist. */
bool heights_surely_overlap(const KernelHeights *pieces, int64_t a, int64_t b);

/* Cut the times of a pair to when heights may overlap (kernel_level_shifts). Returns the doubt of their ends, seconds. */
double heights_cut(const KernelHeights *pieces, Shifted *one);

#endif
