/* Stage 2: which hulls of pieces are disjoint. */
#include <float.h>

#include "kernel.h"
#include "planes/plane.h"

/* A closed ring without its last vertex, which repeats the first. */
typedef struct {
    const double *xy;
    int64_t count;
} Ring;

static Vector corner(const Ring *ring, int64_t k) { return (Vector){ring->xy[2 * k], ring->xy[2 * k + 1]}; }

static double along(Vector axis, Vector place, Vector origin) {
    return axis.x * (place.x - origin.x) + axis.y * (place.y - origin.y);
}

/* Rounding error bound of `is_proof`, relative to size: half an epsilon for each difference, product and sum of a
 * projection; two projections and their difference, at most twice the size: four epsilons, plus higher orders. */
static const double ROUNDING = 5.0 * DBL_EPSILON;

/* Whether all of b lies strictly farther along an axis than all of a. Any such axis proves them disjoint, for any
 * rings. */
static bool is_proof(const Ring *a, const Ring *b, Vector axis) {
    Vector origin = corner(a, 0);
    double end = -INFINITY, start = INFINITY, size = 0.0;
    for (int64_t i = 0; i < a->count; i++) {
        Vector place = corner(a, i);
        end = most(end, along(axis, place, origin));
        size = most(size, fabs(axis.x * (place.x - origin.x)) + fabs(axis.y * (place.y - origin.y)));
    }
    for (int64_t i = 0; i < b->count; i++) {
        Vector place = corner(b, i);
        start = least(start, along(axis, place, origin));
        size = most(size, fabs(axis.x * (place.x - origin.x)) + fabs(axis.y * (place.y - origin.y)));
    }
    return start - end > ROUNDING * size;
}

/* Whether an edge of a separates b. The corner of b nearest to the edge's line turns left as the edges do, so the
 * search follows it from edge to edge. */
static bool is_beyond_edge(const Ring *a, const Ring *b) {
    int64_t nearest = 0;
    for (int64_t k = 0; k < a->count; k++) {
        Vector from = corner(a, k), to = corner(a, k + 1), axis = {to.y - from.y, from.x - to.x};
        double distance = along(axis, corner(b, nearest), from);
        for (int64_t step = 0; step < b->count; step++) {
            int64_t next = nearest + 1 < b->count ? nearest + 1 : 0;
            double there = along(axis, corner(b, next), from);
            /* For the first edge all corners of b are compared. */
            if (there > distance && k > 0) break;
            if (there <= distance) nearest = next, distance = there;
        }
        if (distance > 0.0 && is_proof(a, b, axis)) return true;
    }
    return false;
}

KernelStatus kernel_apart(const double *hull, int64_t vertex_count, const int64_t *hull_offset, int64_t hull_count,
                          const int64_t *a, const int64_t *b, int64_t count, uint8_t *apart) {
    if (vertex_count < 0 || hull_count < 0 || count < 0) return KERNEL_BAD_COUNT;
    if (!hull_offset || (count > 0 && (!hull || !a || !b || !apart))) return KERNEL_NULL;
    if (hull_offset[0] != 0 || hull_offset[hull_count] != vertex_count) return KERNEL_BAD_OFFSET;
    for (int64_t i = 0; i < hull_count; i++)
        if (hull_offset[i + 1] < hull_offset[i]) return KERNEL_BAD_OFFSET;
    for (int64_t i = 0; i < count; i++)
        if (a[i] < 0 || a[i] >= hull_count || b[i] < 0 || b[i] >= hull_count) return KERNEL_BAD_PIECE;
    for (int64_t i = 0; i < count; i++) {
        Ring one = {hull + 2 * hull_offset[a[i]], hull_offset[a[i] + 1] - hull_offset[a[i]] - 1};
        Ring other = {hull + 2 * hull_offset[b[i]], hull_offset[b[i] + 1] - hull_offset[b[i]] - 1};
        apart[i] = one.count > 0 && other.count > 0 && (is_beyond_edge(&one, &other) || is_beyond_edge(&other, &one));
    }
    return KERNEL_OK;
}
