/* Merge consecutive convex polygons into their hulls, as a union of few polygons costs less than a union of many.
 *
 * Greedy: merge the next polygon while the hull exceeds the union of its inputs by at most MOST_ADDED. A step adds the
 * hull's area minus both areas, counting their intersection once. The hull exceeds the union of all its inputs by at
 * most the sum of all steps.
 */
#include <stdlib.h>

#include "kernel.h"
#include "geometry/polygon.h"

/* Largest share of a hull outside the union of its inputs; the hull is then at most a tenth larger than the union. */
static const double MOST_ADDED = 0.09;

static double area(const Polygon *polygon) {
    double twice = 0.0;
    for (int64_t i = 2; i < polygon->count; i++) {
        double x = polygon->x[i] - polygon->x[0], y = polygon->y[i] - polygon->y[0];
        twice += (polygon->x[i - 1] - polygon->x[0]) * y - (polygon->y[i - 1] - polygon->y[0]) * x;
    }
    return 0.5 * twice;
}

static void append(Polygon *to, const Polygon *from) {
    for (int64_t i = 0; i < from->count; i++) to->x[to->count] = from->x[i], to->y[to->count++] = from->y[i];
}

typedef struct {
    double *ring;
    int64_t *offset, *group, count;
} Joined;

/* Write a polygon as a closed ring, unless it is degenerate. */
static void put(Joined *joined, const Polygon *polygon, int64_t group) {
    if (polygon->count < 3) return;
    double *next = joined->ring + 2 * joined->offset[joined->count];
    for (int64_t k = 0; k <= polygon->count; k++, next += 2) {
        int64_t i = k < polygon->count ? k : 0;
        next[0] = polygon->x[i], next[1] = polygon->y[i];
    }
    joined->group[joined->count++] = group;
    joined->offset[joined->count] = (next - joined->ring) / 2;
}

/* The largest number of vertices of one group's consecutive rings. */
static int64_t most_vertices(const int64_t *offset, const int64_t *group, int64_t count) {
    int64_t most = 0;
    for (int64_t i = 0, first = 0; i < count; i++) {
        if (group[i] != group[first]) first = i;
        most = offset[i + 1] - offset[first] > most ? offset[i + 1] - offset[first] : most;
    }
    return most;
}

KernelStatus kernel_joined(const double *ring, int64_t vertex_count, const int64_t *ring_offset, const int64_t *group,
                           int64_t count, double *joined_ring, int64_t *joined_offset, int64_t *joined_group,
                           int64_t *joined_count) {
    if (count < 0 || vertex_count < 0) return KERNEL_BAD_COUNT;
    if (!ring_offset || !joined_offset || !joined_count) return KERNEL_NULL;
    if (count > 0 && (!ring || !group || !joined_ring || !joined_group)) return KERNEL_NULL;
    if (ring_offset[0] != 0 || ring_offset[count] != vertex_count) return KERNEL_BAD_OFFSET;
    for (int64_t i = 0; i < count; i++)
        if (ring_offset[i + 1] < ring_offset[i]) return KERNEL_BAD_OFFSET;
    int64_t most = most_vertices(ring_offset, group, count) + 2;
    enum { POLYGONS = 5 };
    double *memory = malloc(4 * POLYGONS * (size_t)most * sizeof *memory);
    if (!memory) return KERNEL_NO_MEMORY;
    Polygon polygon[POLYGONS];
    for (int k = 0; k < POLYGONS; k++) polygon[k] = (Polygon){.x = memory + 4 * k * most, .y = memory + (4 * k + 2) * most};
    Polygon *held = &polygon[0], *hull = &polygon[1], *next = &polygon[2], *room = &polygon[3], *spare = &polygon[4];
    Joined joined = {joined_ring, joined_offset, joined_group, 0};
    joined_offset[0] = 0;
    double added = 0.0;
    int64_t of = 0;
    for (int64_t i = 0; i < count; i++) {
        const double *corner = ring + 2 * ring_offset[i];
        next->count = ring_offset[i + 1] - ring_offset[i] - 1;
        if (next->count < 3) continue;
        for (int64_t k = 0; k < next->count; k++) next->x[k] = corner[2 * k], next->y[k] = corner[2 * k + 1];
        bool is_first = held->count == 0 || group[i] != of;
        if (!is_first) {
            hull->count = 0;
            append(hull, held);
            append(hull, next);
            polygon_hull(hull, spare);
            double all = area(hull), twice = area(polygon_common(held, next, room, spare));
            double more = added + all - (area(held) + area(next) - twice);
            if (more <= MOST_ADDED * all) {
                Polygon *before = held;
                held = hull, hull = before, added = more;
                continue;
            }
        }
        put(&joined, held, of);
        Polygon *before = held;
        held = next, next = before, added = 0.0, of = group[i];
    }
    put(&joined, held, of);
    *joined_count = joined.count;
    free(memory);
    return KERNEL_OK;
}
