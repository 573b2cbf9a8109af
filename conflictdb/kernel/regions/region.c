/* Regions in which pairs meet during a time: the intersection of both swept hulls.
 *
 * The swept hull of a haven is the convex hull of its positions at both ends of the time, grown by the deviation of the
 * vertices in between (mover_sweep) and by half of the separation.
 *
 * If regions change, raise EDITION of core/conflict_regions.py: databases then rewrite them.
 */
#include <stdlib.h>

#include "scene/border.h"
#include "planes/plane.h"

/* Corners closer than this, metres, are merged, and narrower regions are empty: rounding to degrees, which moves
 * corners by 1e-8 m, must not make sides cross. Rings that may lose a corner are grown by as much. */
static const double LEAST_SIDE_M = 1e-6;
static const double PI = 0x1.921fb54442d18p1;

/* Doubles per vertex of a pair's larger piece: a frame, two positions, two swept hulls, three polygons for
 * intersections. */
enum { PLACE = 2, SWEPT = 2 * 8, KEPT = 2 * 20, PER_VERTEX = FRAME + 2 * PLACE + 2 * SWEPT + 3 * KEPT };

typedef struct {
    const Scene *scene;
    double reach_m;
    double *frame;
    Polygon start, end, a, b, kept, next, spare;
} Bench;

static void lay_out(Bench *bench, double *memory, int64_t largest) {
    Polygon *polygons[7] = {&bench->start, &bench->end, &bench->a, &bench->b, &bench->kept, &bench->next, &bench->spare};
    const int64_t sizes[7] = {PLACE, PLACE, SWEPT, SWEPT, KEPT, KEPT, KEPT};
    double *next = memory + FRAME * largest;
    bench->frame = memory;
    for (int k = 0; k < 7; k++) {
        polygons[k]->x = next, polygons[k]->y = next + sizes[k] / 2 * largest;
        next += sizes[k] * largest;
    }
}

/* Compute the hull that a haven sweeps during [low, high], or the outline of a piece that stands still; grown if asked,
 * as swept hulls always are. False if it is not finite. */
static bool sweep(Bench *bench, const Body *body, const KernelPairs *pairs, int64_t i, bool grown, Polygon *swept) {
    const KernelPlane *plane = &bench->scene->plane;
    Mover mover = mover_make(bench->scene, body, pairs->zero_us[i], (Vector){0.0, 0.0}, bench->frame);
    double low = pairs->low_s[i], high = pairs->high_s[i];
    bool is_still = body->motion == STANDS_STILL;
    Sweep bounds = {0.0, 0.0};
    Polygon *places[2] = {&bench->start, &bench->end};
    mover_place(&mover, low, &bench->start);
    if (is_still) {
        Extent extent = extent_none();
        extent_add(&extent, &bench->start, (Vector){0.0, 0.0});
        bounds.scale = plane_largest_scale(plane, &extent);
    } else {
        double change = 0.0;
        mover_place(&mover, high, &bench->end);
        Vector from = mover_reference(&mover, low), to = mover_reference(&mover, high);
        for (int64_t k = 0; k < bench->start.count; k++)
            change = fmax(change, hypot((bench->end.x[k] - to.x) - (bench->start.x[k] - from.x),
                                        (bench->end.y[k] - to.y) - (bench->start.y[k] - from.y)));
        bounds = mover_sweep(&mover, low, high, change);
    }
    double pad = bounds.deviation + 0.5 * plane_span_m(plane, bench->reach_m, bounds.scale) + 2.0 * LEAST_SIDE_M;
    if (!isfinite(pad)) return false;
    if (is_still && !grown) pad = 0.0;
    swept->count = 0;
    for (int p = 0; p < (is_still ? 1 : 2); p++)
        for (int64_t k = 0; k < places[p]->count; k++)
            for (int corner = 0; corner < (pad > 0.0 ? 4 : 1); corner++) {
                double x = places[p]->x[k] + (corner & 1 ? pad : -pad), y = places[p]->y[k] + (corner & 2 ? pad : -pad);
                if (!isfinite(x) || !isfinite(y)) return false;
                swept->x[swept->count] = x, swept->y[swept->count++] = y;
            }
    polygon_hull(swept, &bench->spare);
    return true;
}

/* Merge close corners; returns whether the polygon is wider than rounding. */
static bool tidy(Polygon *polygon) {
    int64_t count = 0;
    for (int64_t i = 0; i < polygon->count; i++) {
        int64_t before = count > 0 ? count - 1 : polygon->count - 1;
        if (hypot(polygon->x[i] - polygon->x[before], polygon->y[i] - polygon->y[before]) < LEAST_SIDE_M) continue;
        polygon->x[count] = polygon->x[i], polygon->y[count++] = polygon->y[i];
    }
    polygon->count = count;
    double twice = 0.0, around = 0.0;
    for (int64_t i = 1; i < count; i++) {
        double x = polygon->x[i] - polygon->x[0], y = polygon->y[i] - polygon->y[0];
        twice += (polygon->x[i - 1] - polygon->x[0]) * y - (polygon->y[i - 1] - polygon->y[0]) * x;
        around = fmax(around, hypot(x, y));
    }
    return count > 2 && twice > LEAST_SIDE_M * around;
}

/* The intersection of both swept hulls; NULL if unknown, without vertices if empty. */
static Polygon *common(Bench *bench, const KernelPairs *pairs, int64_t i, bool grown) {
    const Body *a = bench->scene->bodies + pairs->a[i], *b = bench->scene->bodies + pairs->b[i];
    if (!sweep(bench, a, pairs, i, grown, &bench->a) || !sweep(bench, b, pairs, i, grown, &bench->b)) return NULL;
    Polygon *found = polygon_common(&bench->a, &bench->b, &bench->kept, &bench->next);
    if (!tidy(found)) found->count = 0;
    return found;
}

/* The region of a pair and its kind; NULL if unknown. */
static Polygon *meet(Bench *bench, const KernelPairs *pairs, int64_t i, Encounter *pair, int8_t *what) {
    const Scene *scene = bench->scene;
    bool stand = scene->bodies[pairs->a[i]].motion == STANDS_STILL && scene->bodies[pairs->b[i]].motion == STANDS_STILL;
    *what = KERNEL_REGION_UNKNOWN;
    if (!border_meet(scene, pairs, i, pair)) return NULL;
    Polygon *found = stand ? common(bench, pairs, i, false) : NULL;
    *what = found && found->count > 0 ? KERNEL_REGION_COMMON : KERNEL_REGION_SWEPT;
    return *what == KERNEL_REGION_COMMON ? found : common(bench, pairs, i, true);
}

/* Write a closed ring, moved east by east_m; returns its end. */
static double *write_ring(const KernelPlane *plane, const Polygon *polygon, double east_m, double *ring) {
    double *next = ring, half_m = PI * plane->radius_m;
    for (int64_t k = 0; k <= polygon->count; k++, next += 2) {
        int64_t i = k < polygon->count ? k : 0;
        next[0] = fmin(fmax(polygon->x[i] + east_m, -half_m), half_m), next[1] = polygon->y[i];
    }
    return next;
}

/* Write one or two rings of a polygon, cut by the antimeridian of a Mercator plane; ends: the end of each. False if it
 * goes around the earth. */
static bool write_rings(const KernelPlane *plane, Polygon *polygon, Polygon *room, double *ring, double *ends[2]) {
    double half_m = PI * plane->radius_m, west = INFINITY, east = -INFINITY;
    for (int64_t i = 0; i < polygon->count; i++) west = fmin(west, polygon->x[i]), east = fmax(east, polygon->x[i]);
    /* Rounding may put a side on the antimeridian beyond it. */
    double home_m = -2.0 * half_m * floor((west + LEAST_SIDE_M + half_m) / (2.0 * half_m));
    if (polygon->count == 0) return true;
    if (plane->projection == KERNEL_GNOMONIC) {
        ends[0] = ends[1] = write_ring(plane, polygon, 0.0, ring);
        return true;
    }
    if (east - west > 2.0 * half_m) return false;
    if (east + home_m <= half_m + LEAST_SIDE_M) {
        ends[0] = ends[1] = write_ring(plane, polygon, home_m, ring);
        return true;
    }
    Vector seam = {half_m - home_m, 0.0};
    polygon_clip(polygon, seam, (Vector){0.0, 1.0}, room, polygon->count + 4);
    if (tidy(room)) ends[0] = write_ring(plane, room, home_m, ring);
    polygon_clip(polygon, seam, (Vector){0.0, -1.0}, room, polygon->count + 4);
    ends[1] = ends[0];
    if (tidy(room)) ends[1] = write_ring(plane, room, home_m - 2.0 * half_m, ends[0]);
    return true;
}

KernelStatus kernel_regions(const KernelScene *scene, const KernelPairs *pairs, double reach_m, double *ring,
                            int64_t *ring_offset, int8_t *what) {
    double *memory;
    Encounter pair = {.separation_m = reach_m};
    if (!ring_offset || (pairs && pairs->count > 0 && (!ring || !what))) return KERNEL_NULL;
    KernelStatus status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    int64_t largest = 1;
    for (int64_t i = 0; i < pairs->count; i++) {
        int64_t a = scene->bodies[pairs->a[i]].count, b = scene->bodies[pairs->b[i]].count;
        largest = a > largest ? a : largest, largest = b > largest ? b : largest;
    }
    double *more = malloc(PER_VERTEX * (size_t)largest * sizeof *more);
    if (!more) {
        free(memory);
        return KERNEL_NO_MEMORY;
    }
    Bench bench = {.scene = scene, .reach_m = reach_m};
    lay_out(&bench, more, largest);
    ring_offset[0] = 0;
    for (int64_t i = 0; i < pairs->count; i++) {
        Polygon *found = meet(&bench, pairs, i, &pair, what + i);
        double *start = ring + 2 * ring_offset[2 * i], *ends[2] = {start, start};
        if (!found || !write_rings(&scene->plane, found, &bench.spare, start, ends)) what[i] = KERNEL_REGION_UNKNOWN;
        ring_offset[2 * i + 1] = (ends[0] - ring) / 2, ring_offset[2 * i + 2] = (ends[1] - ring) / 2;
    }
    free(more);
    free(memory);
    return KERNEL_OK;
}
