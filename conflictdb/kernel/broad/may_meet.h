/* The rule of a pair of pieces (stage 1). sql/20_stage1_broad_phase.sql states it for the database. */
#ifndef MAY_MEET_H
#define MAY_MEET_H

#include <stdbool.h>

#include "kernel.h"

/* Whether two boxes (min x, min y, max x, max y) intersect. */
static inline bool boxes_meet(const double *a, const double *b) {
    return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

static inline bool heights_meet(double a_floor_m, double a_ceiling_m, double b_floor_m, double b_ceiling_m) {
    return a_floor_m < b_ceiling_m && b_floor_m < a_ceiling_m;
}

typedef struct {
    int64_t start_us, end_us;
    bool end_inclusive;
} Span;

/* Whether two time spans have instants that are at most within_us apart. */
static inline bool times_meet(Span a, Span b, int64_t within_us) {
    int64_t start_us = a.start_us > b.start_us ? a.start_us : b.start_us;
    int64_t end_us = a.end_us < b.end_us ? a.end_us : b.end_us;
    if (start_us < end_us) return true;
    uint64_t apart_us = (uint64_t)start_us - (uint64_t)end_us;
    if (apart_us != (uint64_t)within_us) return apart_us < (uint64_t)within_us;
    return (a.end_us > end_us || a.end_inclusive) && (b.end_us > end_us || b.end_inclusive);
}

static inline Span span_of(const KernelBoxes *rows, int64_t i) {
    return (Span){rows->start_us[i], rows->end_us[i], !rows->end_inclusive || rows->end_inclusive[i]};
}

/* Whether two pieces of different objects, rows i of a and j of b, may meet. */
static inline bool may_meet(const KernelBoxes *a, int64_t i, const KernelBoxes *b, int64_t j, const KernelCompared *compared) {
    if (a->boxes && b->boxes && !boxes_meet(a->boxes + 4 * i, b->boxes + 4 * j)) return false;
    if (!times_meet(span_of(a, i), span_of(b, j), compared->within_us)) return false;
    if (!heights_meet(a->floor_m[i], a->ceiling_m[i], b->floor_m[j], b->ceiling_m[j])) return false;
    /* Of two seam copies the originals meet, too. */
    if (a->is_copy[i] && b->is_copy[j]) return false;
    if (a->owner && b->owner && a->owner[i] != 0 && a->owner[i] == b->owner[j]) return false;
    return !compared->of_types || compared->of_types[compared->type_count * a->type[i] + b->type[j]];
}

#endif
