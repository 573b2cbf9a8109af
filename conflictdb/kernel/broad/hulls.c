/* Padded swept hulls of pieces, which stages 1 and 2 compare. */
#include <stdlib.h>

#include "scene/border.h"
#include "planes/plane.h"

/* The corner of two grown edges replaces the squares' corners if it is within this many paddings along either axis, and
 * if the edges turn by at least this sine, so that it keeps its digits. Right angles are within 2. */
static const double FURTHEST_CORNER = 2.5, LEAST_TURN = 0.1;

/* Memory for the current piece: a scene of that piece alone, its positions at both ends of its slice, their hull, and
 * spare room. */
typedef struct {
    Scene alone;
    Body body;
    double *frame;
    Polygon start, end, both, spare;
} Bench;

/* Doubles per vertex: columns, a frame, and polygons; the last two polygons have two and four times the vertices. */
enum { PER_VERTEX = CIRCLE_COLUMNS + FRAME + 2 * (1 + 1 + 2 + 4) };

static void lay_out(Bench *bench, double *memory, int64_t largest) {
    bench->alone.bodies = &bench->body;
    bench->alone.columns = memory;
    bench->frame = memory + CIRCLE_COLUMNS * largest;
    double *next = bench->frame + FRAME * largest;
    Polygon *polygons[4] = {&bench->start, &bench->end, &bench->both, &bench->spare};
    const int64_t sizes[4] = {largest, largest, 2 * largest, 4 * largest};
    for (int k = 0; k < 4; k++) {
        polygons[k]->x = next, polygons[k]->y = next + sizes[k];
        next += 2 * sizes[k];
    }
}

/* Piece i as the only piece of its arrays. offset: room for two. */
static KernelPieces alone_of(const KernelPieces *pieces, int64_t i, int64_t offset[2]) {
    int64_t first = pieces->shape_offset[i];
    KernelPieces one = {.count = 1, .vertex_count = pieces->shape_offset[i + 1] - first};
    one.moves = pieces->moves + i, one.turn = pieces->turn + i;
    one.start_us = pieces->start_us + i, one.end_us = pieces->end_us + i;
    one.leg_start_us = pieces->leg_start_us + i, one.leg_end_us = pieces->leg_end_us + i;
    one.leg_start_deg = pieces->leg_start_deg + 2 * i, one.leg_end_deg = pieces->leg_end_deg + 2 * i;
    one.bearing_deg = pieces->bearing_deg + i;
    one.shape = pieces->shape + 2 * first;
    one.shape_to = pieces->shape_to ? pieces->shape_to + 2 * first : NULL;
    offset[0] = 0, offset[1] = one.vertex_count;
    one.shape_offset = offset;
    return one;
}

static bool is_polygon_finite(const Polygon *polygon) {
    for (int64_t i = 0; i < polygon->count; i++)
        if (!isfinite(polygon->x[i]) || !isfinite(polygon->y[i])) return false;
    return true;
}

static bool is_ring_finite(const double *ring, const double *end) {
    for (; ring < end; ring++)
        if (!isfinite(*ring)) return false;
    return true;
}

static void append(Polygon *polygon, const Polygon *more) {
    for (int64_t i = 0; i < more->count; i++, polygon->count++)
        polygon->x[polygon->count] = more->x[i], polygon->y[polygon->count] = more->y[i];
}

/* Compute a haven's positions at both ends of its slice; returns bounds on the motion in between, and the largest
 * distance of its vertices from the reference point. */
static Sweep sweep_haven(Bench *bench, const KernelPieces *one, double *reach) {
    Mover mover = mover_make(&bench->alone, &bench->body, one->start_us[0], (Vector){0.0, 0.0}, bench->frame);
    double duration = (double)(one->end_us[0] - one->start_us[0]) / 1e6, change = 0.0;
    mover_place(&mover, 0.0, &bench->start);
    mover_place(&mover, duration, &bench->end);
    Vector start = mover_reference(&mover, 0.0), end = mover_reference(&mover, duration);
    for (int64_t i = 0; i < bench->start.count; i++) {
        Vector first = {bench->start.x[i] - start.x, bench->start.y[i] - start.y};
        Vector last = {bench->end.x[i] - end.x, bench->end.y[i] - end.y};
        *reach = most(*reach, most(norm(first), norm(last)));
        change = most(change, hypot(last.x - first.x, last.y - first.y));
    }
    append(&bench->both, &bench->start);
    append(&bench->both, &bench->end);
    return mover_sweep(&mover, 0.0, duration, change);
}

static Sweep sweep_area(Bench *bench) {
    Mover mover = mover_make(&bench->alone, &bench->body, 0, (Vector){0.0, 0.0}, bench->frame);
    Extent extent = extent_none();
    mover_place(&mover, 0.0, &bench->start);
    extent_add(&extent, &bench->start, (Vector){0.0, 0.0});
    append(&bench->both, &bench->start);
    return (Sweep){0.0, plane_largest_scale(&bench->alone.plane, &extent)};
}

/* The edge from vertex k of a convex polygon. */
static Vector edge_of(const Polygon *polygon, int64_t k) {
    int64_t m = edge_end(polygon, k);
    return (Vector){polygon->x[m] - polygon->x[k], polygon->y[m] - polygon->y[k]};
}

static const Vector CORNERS[4] = {{1.0, 1.0}, {-1.0, 1.0}, {-1.0, -1.0}, {1.0, -1.0}};

/* The corner of a square farthest outward of an edge, the later one of two. Corners follow each other as edges turn
 * left. */
static int furthest_corner(Vector edge) {
    if (edge.y > 0.0 && edge.x <= 0.0) return 0;
    if (edge.y <= 0.0 && edge.x < 0.0) return 1;
    return edge.y < 0.0 ? 2 : 3;
}

/* Number of corners by which a grown ring turns at a vertex: from the later corner of the incoming edge to the first of
 * the outgoing one. */
static int corners_between(Vector in, Vector out) {
    bool is_along_axis = out.x == 0.0 || out.y == 0.0;
    int steps = (furthest_corner(out) - is_along_axis - furthest_corner(in) + 8) % 4;
    /* At most half a turn: three steps mean one step back, for edges equal to rounding. */
    return steps < 3 ? steps : 0;
}

/* Intersection of two edges grown by squares of half side 1, relative to the vertex between them; false if far away. */
static bool grown_corner(Vector in, Vector out, Vector *corner) {
    double turn = cross(in, out), squares = (in.x * in.x + in.y * in.y) * (out.x * out.x + out.y * out.y);
    if (!(turn > 0.0) || !(turn * turn > LEAST_TURN * LEAST_TURN * squares)) return false;
    double in_reach = fabs(in.x) + fabs(in.y), out_reach = fabs(out.x) + fabs(out.y);
    *corner = (Vector){(in.x * out_reach - out.x * in_reach) / turn, (in.y * out_reach - out.y * in_reach) / turn};
    return fabs(corner->x) <= FURTHEST_CORNER && fabs(corner->y) <= FURTHEST_CORNER;
}

static double *add_vertex(double *ring, const Polygon *hull, int64_t k, Vector from, double pad) {
    ring[0] = hull->x[k] + pad * from.x, ring[1] = hull->y[k] + pad * from.y;
    return ring + 2;
}

/* Write the closed ring of a convex hull grown by squares of half side pad; returns its end. */
static double *grow(const Polygon *hull, double pad, double *ring) {
    double *next = ring;
    Vector in = edge_of(hull, hull->count - 1);
    for (int64_t k = 0; k < hull->count; k++) {
        Vector out = edge_of(hull, k), corner;
        bool is_point = in.x == 0.0 && in.y == 0.0;
        int from = furthest_corner(in), steps = is_point ? 3 : corners_between(in, out);
        if (steps > 0 && grown_corner(in, out, &corner)) next = add_vertex(next, hull, k, corner, pad);
        else
            for (int step = 0; step <= steps; step++) next = add_vertex(next, hull, k, CORNERS[(from + step) % 4], pad);
        in = out;
        if (is_point) break;
    }
    next[0] = ring[0], next[1] = ring[1];
    return next + 2;
}

/* Write the hull of piece i and its bounds; returns its end, or `ring` if the piece is invalid. */
static double *hull_of(Bench *bench, const KernelPieces *pieces, int64_t i, double reach_m, double *ring, Sweep *sweep,
                       double *reach) {
    int64_t offset[2];
    KernelPieces one = alone_of(pieces, i, offset);
    bench->alone.vertex_count = one.vertex_count, bench->both.count = 0;
    border_prepare(&bench->alone, &one, 0);
    if (!bench->body.is_sound) return ring;
    *sweep = bench->body.motion == STANDS_STILL ? sweep_area(bench) : sweep_haven(bench, &one, reach);
    const KernelPlane *plane = &bench->alone.plane;
    double pad = sweep->deviation + 0.5 * plane_span_m(plane, reach_m, sweep->scale) + KERNEL_ROUNDING_M;
    if (!isfinite(pad) || !is_polygon_finite(&bench->both)) return ring;
    polygon_hull(&bench->both, &bench->spare);
    double *end = grow(&bench->both, pad, ring);
    /* No hull if padding exceeds the range of doubles. */
    return is_ring_finite(ring, end) ? end : ring;
}

KernelStatus kernel_hulls(const KernelPlane *plane, const KernelPieces *pieces, int64_t first, int64_t end, double reach_m,
                          double *hull, int64_t *hull_offset, double *deviation, double *reach) {
    if (!plane || !pieces || !hull_offset) return KERNEL_NULL;
    KernelStatus status = border_check_plane(plane);
    if (status == KERNEL_OK) status = border_check_pieces(pieces);
    if (status != KERNEL_OK) return status;
    if (!(reach_m >= 0.0) || !isfinite(reach_m)) return KERNEL_BAD_DISTANCE;
    if (first < 0 || end < first || end > pieces->count) return KERNEL_BAD_RANGE;
    if (end > first && (!hull || !deviation || !reach)) return KERNEL_NULL;
    int64_t largest = 1;
    for (int64_t i = first; i < end; i++) {
        int64_t count = pieces->shape_offset[i + 1] - pieces->shape_offset[i];
        largest = count > largest ? count : largest;
    }
    double *memory = malloc(PER_VERTEX * (size_t)largest * sizeof *memory), *next = hull;
    if (!memory) return KERNEL_NO_MEMORY;
    Bench bench = {.alone = {.plane = *plane, .count = 1}};
    lay_out(&bench, memory, largest);
    hull_offset[0] = 0;
    for (int64_t i = first; i < end; i++) {
        Sweep sweep = {NAN, NAN};
        reach[i - first] = 0.0;
        next = hull_of(&bench, pieces, i, reach_m, next, &sweep, reach + (i - first));
        deviation[i - first] = sweep.deviation;
        hull_offset[i - first + 1] = (next - hull) / 2;
    }
    free(memory);
    return KERNEL_OK;
}
