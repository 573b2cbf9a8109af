/* The rule of a pair of pieces (stage 1). For the database sql/20_stage1_broad_phase.sql states it, and of types
 * sql/12_rules.sql (_are_compared). */
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

/* Whether the first span ended more than within_us before the second one begins. */
static inline bool is_over(Span a, Span b, int64_t within_us) {
    return a.end_us < b.start_us && (uint64_t)b.start_us - (uint64_t)a.end_us > (uint64_t)within_us;
}

/* The numbers of a row. CLASS is not read: types are of classes. */
enum { CLASS, OWNER };

/* A piece, or several: a bundle, or a node of a tree. */
typedef struct {
    const double *box; /* NULL: not compared */
    double floor_m, ceiling_m;
    Span span;
    bool is_copy; /* of several: all are */
    const int64_t *numbers; /* NULL: none, or several */
    int64_t type;
} Row;

static inline Row row_of(const KernelBoxes *rows, int64_t i) {
    return (Row){
        .box = rows->boxes ? rows->boxes + 4 * i : NULL,
        .floor_m = rows->floor_m[i],
        .ceiling_m = rows->ceiling_m[i],
        .span = {rows->start_us[i], rows->end_us[i], !rows->end_inclusive || rows->end_inclusive[i]},
        .is_copy = rows->is_copy[i] != 0,
        .numbers = rows->numbers ? rows->numbers + KERNEL_NUMBERS * i : NULL,
        .type = rows->type ? rows->type[i] : 0,
    };
}

/* Whether objects with these numbers, 0: without, are compared. */
static inline bool numbers_meet(const int64_t *a, const int64_t *b) { return a[OWNER] == 0 || a[OWNER] != b[OWNER]; }

/* Whether two rows of different objects may meet. */
static inline bool may_meet(Row a, Row b, const KernelCompared *compared) {
    if (a.box && b.box && !boxes_meet(a.box, b.box)) return false;
    if (!times_meet(a.span, b.span, compared->within_us)) return false;
    if (!heights_meet(a.floor_m, a.ceiling_m, b.floor_m, b.ceiling_m)) return false;
    /* Of two seam copies the originals meet, too. */
    if (a.is_copy && b.is_copy) return false;
    if (a.numbers && b.numbers && !numbers_meet(a.numbers, b.numbers)) return false;
    return !compared->of_types || compared->of_types[compared->type_count * a.type + b.type];
}

/* Whether rows have all columns that may_meet reads, and types below the number of types. */
KernelStatus check_compared(const KernelBoxes *rows, const KernelCompared *compared);

#endif
