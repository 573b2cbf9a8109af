/* Bundles: several pieces of one object, close to each other, stored and looked up as one row. Grouping pieces into
 * bundles, and the pairs of pieces of two bundles (the rest of stage 1). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "broad/may_meet.h"
#include "kernel.h"
#include "planes/plane.h"

/* A bundle of slices covers at most this multiple of its smallest slice's area. Larger: more pairs of bundles, and more
 * pieces compared in vain. Smaller: more rows to store and look up. */
static const double MOST_SLICES_AREA = 32.0;
/* Most slices of a bundle, all of which are read to get one of them. */
static const int64_t MOST_SLICES = 64;
/* The parts of an area are split into two bundles if that saves more area than this fraction of the whole area's box,
 * per bundle. */
static const double BUNDLE_SHARE = 1.0 / 8.0;
/* Most nested splits. */
enum { MOST_HALVINGS = 4 };

typedef struct {
    double low_x, low_y, high_x, high_y;
} Box;

static const Box NO_BOX = {INFINITY, INFINITY, -INFINITY, -INFINITY};

static Box box_of(const double *boxes, int64_t i) {
    const double *box = boxes + 4 * i;
    return (Box){box[0], box[1], box[2], box[3]};
}

static Box joined(Box a, Box b) {
    return (Box){least(a.low_x, b.low_x), least(a.low_y, b.low_y), most(a.high_x, b.high_x), most(a.high_y, b.high_y)};
}

static double area(Box box) { return (box.high_x - box.low_x) * (box.high_y - box.low_y); }

/* The parts of an area: their order, bundle by bundle, and where bundles begin. share: the cost of a bundle, as an
 * area. */
typedef struct {
    const double *boxes;
    int64_t *order, *spare;
    uint8_t *begins;
    double share;
} Parts;

/* Partition the parts [first, end) by the centre along the longer side of the box of centres; both halves keep their
 * order. Returns the size of the lower half, 0 if all centres are equal. */
static int64_t halve(Parts *parts, int64_t first, int64_t end) {
    Box centres = NO_BOX;
    for (int64_t i = first; i < end; i++) {
        Box box = box_of(parts->boxes, parts->order[i]);
        double x = 0.5 * (box.low_x + box.high_x), y = 0.5 * (box.low_y + box.high_y);
        centres = joined(centres, (Box){x, y, x, y});
    }
    bool is_x = centres.high_x - centres.low_x >= centres.high_y - centres.low_y;
    double middle = is_x ? centres.low_x + centres.high_x : centres.low_y + centres.high_y;
    int64_t lower = 0, upper = 0;
    for (int64_t i = first; i < end; i++) {
        int64_t part = parts->order[i];
        Box box = box_of(parts->boxes, part);
        if ((is_x ? box.low_x + box.high_x : box.low_y + box.high_y) < middle) parts->order[first + lower++] = part;
        else parts->spare[upper++] = part;
    }
    memcpy(parts->order + first + lower, parts->spare, (size_t)upper * sizeof *parts->spare);
    return upper > 0 ? lower : 0;
}

/* Mark where bundles begin among the parts [first, end), and return their cost: areas plus `share` for each. Split
 * recursively while that costs less. */
static double bundle_parts(Parts *parts, int64_t first, int64_t end, int halvings) {
    Box whole = NO_BOX;
    for (int64_t i = first; i < end; i++) whole = joined(whole, box_of(parts->boxes, parts->order[i]));
    double as_one = area(whole) + parts->share;
    parts->begins[first] = 1;
    if (end - first < 2 || halvings == 0) return as_one;
    int64_t lower = halve(parts, first, end);
    if (lower == 0) return as_one;
    double apart = bundle_parts(parts, first, first + lower, halvings - 1);
    apart += bundle_parts(parts, first + lower, end, halvings - 1);
    if (apart < as_one) return apart;
    memset(parts->begins + first + 1, 0, (size_t)(end - first - 1));
    return as_one;
}

/* Mark where bundles begin among the slices [first, end) of a track, which keep their order: greedily, in order of
 * time. */
static void bundle_slices(const double *boxes, uint8_t *begins, int64_t first, int64_t end) {
    int64_t start = first;
    Box whole = NO_BOX;
    double smallest = INFINITY;
    for (int64_t i = first; i < end; i++) {
        Box box = box_of(boxes, i), with = joined(whole, box);
        double least_area = least(smallest, area(box));
        bool is_new = i == first || i - start >= MOST_SLICES || !(area(with) <= MOST_SLICES_AREA * least_area);
        begins[i] = is_new;
        if (is_new) start = i;
        whole = is_new ? box : with, smallest = is_new ? area(box) : least_area;
    }
}

KernelStatus kernel_bundles(const double *boxes, const int64_t *run, const uint8_t *moves, int64_t count, int64_t *order,
                            uint8_t *begins) {
    if (count < 0) return KERNEL_BAD_COUNT;
    if (count > 0 && (!boxes || !run || !moves || !order || !begins)) return KERNEL_NULL;
    int64_t *spare = malloc((size_t)(count ? count : 1) * sizeof *spare);
    if (!spare) return KERNEL_NO_MEMORY;
    Parts parts = {.boxes = boxes, .order = order, .spare = spare, .begins = begins};
    for (int64_t i = 0; i < count; i++) order[i] = i, begins[i] = 0;
    for (int64_t first = 0, end; first < count; first = end) {
        Box whole = NO_BOX;
        for (end = first; end < count && run[end] == run[first]; end++) whole = joined(whole, box_of(boxes, end));
        parts.share = BUNDLE_SHARE * area(whole);
        if (moves[first]) bundle_slices(boxes, begins, first, end);
        else bundle_parts(&parts, first, end, MOST_HALVINGS);
    }
    free(spare);
    return KERNEL_OK;
}

static bool meet(const double *box, Box bounds) {
    return boxes_meet(box, (const double[]){bounds.low_x, bounds.low_y, bounds.high_x, bounds.high_y});
}

KernelStatus kernel_bundled_pairs(const KernelBoxes *pieces, const int64_t *offset, int64_t bundles,
                                  const KernelCompared *compared, const int64_t *a, const int64_t *b, int64_t count,
                                  int64_t *first, int64_t *second, int64_t room, int64_t *found) {
    KernelStatus status = check_compared(pieces, compared);
    if (status != KERNEL_OK) return status;
    if (!found || !offset || (pieces->count > 0 && !pieces->boxes)) return KERNEL_NULL;
    if (bundles < 0 || count < 0 || room < 0) return KERNEL_BAD_COUNT;
    if ((count > 0 && (!a || !b)) || (room > 0 && (!first || !second))) return KERNEL_NULL;
    if (offset[0] != 0 || offset[bundles] != pieces->count) return KERNEL_BAD_OFFSET;
    int64_t largest = 1;
    for (int64_t k = 0; k < bundles; k++) {
        if (offset[k + 1] < offset[k]) return KERNEL_BAD_OFFSET;
        if (offset[k + 1] - offset[k] > largest) largest = offset[k + 1] - offset[k];
    }
    for (int64_t k = 0; k < count; k++)
        if (a[k] < 0 || a[k] >= bundles || b[k] < 0 || b[k] >= bundles) return KERNEL_BAD_PIECE;
    Box *whole = malloc((size_t)(bundles + 1) * sizeof *whole);
    int64_t *near = malloc((size_t)largest * sizeof *near);
    status = whole && near ? KERNEL_OK : KERNEL_NO_MEMORY;
    *found = 0;
    for (int64_t k = 0; status == KERNEL_OK && k < bundles; k++) {
        whole[k] = NO_BOX;
        for (int64_t i = offset[k]; i < offset[k + 1]; i++) whole[k] = joined(whole[k], box_of(pieces->boxes, i));
    }
    for (int64_t k = 0; status == KERNEL_OK && k < count; k++) {
        int64_t nearest = 0, passed = 0;
        for (int64_t j = offset[b[k]]; j < offset[b[k] + 1]; j++)
            if (meet(pieces->boxes + 4 * j, whole[a[k]])) near[nearest++] = j;
        for (int64_t i = offset[a[k]]; status == KERNEL_OK && i < offset[a[k] + 1]; i++) {
            const Row piece = row_of(pieces, i);
            if (!meet(piece.box, whole[b[k]])) continue;
            /* A bundle is in order of time: a piece that is over when this one begins cannot meet any later one. */
            while (passed < nearest && is_over(row_of(pieces, near[passed]).span, piece.span, compared->within_us)) passed++;
            for (int64_t n = passed; n < nearest; n++) {
                const Row other = row_of(pieces, near[n]);
                if (is_over(piece.span, other.span, compared->within_us)) break;
                if (!may_meet(piece, other, compared)) continue;
                if (*found == room) {
                    status = KERNEL_BAD_COUNT;
                    break;
                }
                first[*found] = i, second[*found] = near[n], ++*found;
            }
        }
    }
    free(whole), free(near);
    return status;
}
