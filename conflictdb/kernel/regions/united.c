/* The union of convex polygons of the plane.
 *
 * Each polygon cuts an interval out of each side of another. What is left of all sides is the boundary of the union; where
 * one side enters another polygon through a side of it, the boundary goes on along that side. Sides that lie on each other,
 * as those of neighbouring parts do, are no special case: every polygon is grown a little, and each by another width. Where
 * rounding decides all the same, the boundary does not close, and there is no union.
 */
#include <math.h>
#include <stdlib.h>

#include "regions/rings.h"

/* Every polygon is grown by this, plane metres, and up to twice as much: rounding is 7.5e-9 m. An acute corner is cut if
 * it grows further than MOST_GROWN_M. */
static const double LEAST_GROWN_M = 1e-4, MOST_GROWN_M = 1e-3;
/* Holes whose mean width is less than this, plane metres, are filled. */
static const double NARROW_M = 1e-3;
static const double ROUNDING = 1e-15;

enum { NONE = -1 };

/* A side: its polygon, and its ends. */
typedef struct {
    int64_t polygon;
    double from[2], to[2];
} Edge;

/* Sides of a polygon [first, end), and its bounds. */
typedef struct {
    int64_t first, end;
    double west, east, south, north;
} Convex;

/* The part of a side inside of another polygon: from where to where, through which of its sides; NONE: from the start, to
 * the end. */
typedef struct {
    double from, to;
    int64_t enters, leaves;
} Inside;

/* A part of a side on the boundary of the union: where it starts, after which side, and before which it ends; NONE: at the
 * side's own start and end. */
typedef struct {
    double start[2];
    int64_t edge, after, before, next;
} Fragment;

struct Uniting {
    Edge *edges;
    Convex *polygons;
    Inside *insides;
    Fragment *fragments;
    int64_t edge_count, edge_room, polygon_room, fragment_count, fragment_room;
};

void rings_clear(Rings *rings) { rings->count = rings->vertices = 0; }

bool rings_make_room(Rings *rings, int64_t more_rings, int64_t more_vertices) {
    if (rings->count + more_rings > rings->ring_room) {
        int64_t room = 2 * (rings->count + more_rings);
        int64_t *offset = realloc(rings->offset, (size_t)(room + 1) * sizeof *offset);
        if (offset) rings->offset = offset, rings->offset[0] = 0;
        int8_t *is_hole = realloc(rings->is_hole, (size_t)room);
        if (is_hole) rings->is_hole = is_hole;
        if (!offset || !is_hole) return false;
        rings->ring_room = room;
    }
    if (rings->vertices + more_vertices > rings->vertex_room) {
        int64_t room = 2 * (rings->vertices + more_vertices);
        double (*vertex)[2] = realloc(rings->vertex, (size_t)room * sizeof *vertex);
        if (!vertex) return false;
        rings->vertex = vertex, rings->vertex_room = room;
    }
    return true;
}

void rings_free(Rings *rings) {
    free(rings->vertex), free(rings->offset), free(rings->is_hole);
    *rings = (Rings){0};
}

double ring_doubled_area(const double (*vertex)[2], int64_t count) {
    double twice = 0.0;
    for (int64_t i = 2; i < count; i++)
        twice += (vertex[i - 1][0] - vertex[0][0]) * (vertex[i][1] - vertex[0][1]) -
                 (vertex[i - 1][1] - vertex[0][1]) * (vertex[i][0] - vertex[0][0]);
    return twice;
}

double turn_of(const double *from, const double *to, const double *at) {
    double one = (to[0] - from[0]) * (at[1] - from[1]), other = (to[1] - from[1]) * (at[0] - from[0]);
    return fabs(one - other) > ROUNDING * (fabs(one) + fabs(other)) ? one - other : 0.0;
}

int rings_hold(const Rings *rings, const double *place) {
    bool is_inside = false;
    for (int64_t ring = 0; ring < rings->count; ring++) {
        for (int64_t i = rings->offset[ring], end = rings->offset[ring + 1], k = end - 1; i < end; k = i++) {
            const double *from = rings->vertex[k], *to = rings->vertex[i];
            bool crosses = (from[1] > place[1]) != (to[1] > place[1]);
            /* A side that only touches the line of latitude may still contain the place. */
            if (!crosses && (place[1] < fmin(from[1], to[1]) || place[1] > fmax(from[1], to[1]))) continue;
            if (fmax(from[0], to[0]) < place[0]) continue;
            if (fmin(from[0], to[0]) > place[0]) {
                is_inside ^= crosses;
                continue;
            }
            double turn = turn_of(from, to, place);
            if (turn == 0.0) return -1;
            if (crosses) is_inside ^= (turn > 0.0) == (to[1] > from[1]);
        }
    }
    return is_inside;
}

Uniting *uniting_make(void) { return calloc(1, sizeof(Uniting)); }

void uniting_free(Uniting *uniting) {
    if (!uniting) return;
    free(uniting->edges), free(uniting->polygons), free(uniting->insides), free(uniting->fragments);
    free(uniting);
}

static bool make_room(Uniting *uniting, int64_t edges, int64_t polygons) {
    if (edges > uniting->edge_room) {
        Edge *more = realloc(uniting->edges, 2 * (size_t)edges * sizeof *more);
        if (!more) return false;
        uniting->edges = more, uniting->edge_room = 2 * edges;
    }
    if (polygons > uniting->polygon_room) {
        Convex *more = realloc(uniting->polygons, 2 * (size_t)polygons * sizeof *more);
        if (more) uniting->polygons = more;
        Inside *insides = realloc(uniting->insides, 2 * (size_t)polygons * sizeof *insides);
        if (insides) uniting->insides = insides;
        if (!more || !insides) return false;
        uniting->polygon_room = 2 * polygons;
    }
    return true;
}

static Vector normal_of(const double *from, const double *to) {
    double x = to[0] - from[0], y = to[1] - from[1], length = sqrt(x * x + y * y);
    return length > 0.0 ? (Vector){y / length, -x / length} : (Vector){0.0, 0.0};
}

static void add_corner(Uniting *uniting, Convex *polygon, const double *corner, Vector step) {
    Edge *edge = uniting->edges + uniting->edge_count++;
    edge->from[0] = corner[0] + step.x, edge->from[1] = corner[1] + step.y;
    polygon->west = fmin(polygon->west, edge->from[0]), polygon->east = fmax(polygon->east, edge->from[0]);
    polygon->south = fmin(polygon->south, edge->from[1]), polygon->north = fmax(polygon->north, edge->from[1]);
}

/* Append the sides of a polygon (count corners, the first repeated), grown. */
static void add_polygon(Uniting *uniting, int64_t number, const double *ring, int64_t count, double grown_m) {
    Convex *polygon = uniting->polygons + number;
    *polygon = (Convex){uniting->edge_count, 0, INFINITY, -INFINITY, INFINITY, -INFINITY};
    for (int64_t i = 0; i < count; i++) {
        const double *before = ring + 2 * (i > 0 ? i - 1 : count - 1), *corner = ring + 2 * i, *after = ring + 2 * (i + 1);
        Vector one = normal_of(before, corner), other = normal_of(corner, after);
        Vector step = step_for(one, grown_m, other, grown_m);
        if (hypot(step.x, step.y) <= MOST_GROWN_M) {
            add_corner(uniting, polygon, corner, step);
        } else {
            add_corner(uniting, polygon, corner, (Vector){grown_m * one.x, grown_m * one.y});
            add_corner(uniting, polygon, corner, (Vector){grown_m * other.x, grown_m * other.y});
        }
    }
    polygon->end = uniting->edge_count;
    for (int64_t i = polygon->first; i < polygon->end; i++) {
        const Edge *next = uniting->edges + (i + 1 < polygon->end ? i + 1 : polygon->first);
        uniting->edges[i].polygon = number, uniting->edges[i].to[0] = next->from[0], uniting->edges[i].to[1] = next->from[1];
    }
}

/* The part of a side inside of another polygon; false if there is none. */
static bool cut_out(const Uniting *uniting, const Edge *edge, const Convex *polygon, Inside *inside) {
    if (fmax(edge->from[0], edge->to[0]) < polygon->west || fmin(edge->from[0], edge->to[0]) > polygon->east) return false;
    if (fmax(edge->from[1], edge->to[1]) < polygon->south || fmin(edge->from[1], edge->to[1]) > polygon->north) return false;
    *inside = (Inside){0.0, 1.0, NONE, NONE};
    for (int64_t k = polygon->first; k < polygon->end; k++) {
        const Edge *side = uniting->edges + k;
        double x = side->to[0] - side->from[0], y = side->to[1] - side->from[1];
        double start = x * (edge->from[1] - side->from[1]) - y * (edge->from[0] - side->from[0]);
        double end = x * (edge->to[1] - side->from[1]) - y * (edge->to[0] - side->from[0]);
        if (start <= 0.0 && end <= 0.0) return false;
        if (start > 0.0 && end > 0.0) continue;
        double share = start / (start - end);
        if (start <= 0.0 && share > inside->from) inside->from = share, inside->enters = k;
        if (end <= 0.0 && share < inside->to) inside->to = share, inside->leaves = k;
        if (inside->from >= inside->to) return false;
    }
    return true;
}

static bool add_fragment(Uniting *uniting, int64_t edge, double from, int64_t after, int64_t before) {
    if (uniting->fragment_count == uniting->fragment_room) {
        int64_t room = 2 * uniting->fragment_room + 32;
        Fragment *more = realloc(uniting->fragments, (size_t)room * sizeof *more);
        if (!more) return false;
        uniting->fragments = more, uniting->fragment_room = room;
    }
    const Edge *of = uniting->edges + edge;
    Fragment *fragment = uniting->fragments + uniting->fragment_count++;
    *fragment = (Fragment){.edge = edge, .after = after, .before = before, .next = NONE};
    for (int k = 0; k < 2; k++) fragment->start[k] = of->from[k] + from * (of->to[k] - of->from[k]);
    return true;
}

/* Append what is left of a side outside of all other polygons; false without memory. */
static bool add_fragments(Uniting *uniting, int64_t number, int64_t polygons) {
    const Edge *edge = uniting->edges + number;
    int64_t count = 0;
    for (int64_t k = 0; k < polygons; k++) {
        Inside inside;
        if (k == edge->polygon || !cut_out(uniting, edge, uniting->polygons + k, &inside)) continue;
        int64_t at = count++;
        for (; at > 0 && uniting->insides[at - 1].from > inside.from; at--) uniting->insides[at] = uniting->insides[at - 1];
        uniting->insides[at] = inside;
    }
    double from = 0.0;
    int64_t after = NONE;
    for (int64_t k = 0; k < count; k++) {
        const Inside *inside = uniting->insides + k;
        if (inside->from > from && inside->enters != NONE && !add_fragment(uniting, number, from, after, inside->enters))
            return false;
        if (inside->to > from) from = inside->to, after = inside->leaves;
        if (inside->leaves == NONE) return true;
    }
    return add_fragment(uniting, number, from, after, NONE);
}

/* Find the fragment that follows each; false if one is missing. */
static bool link_fragments(Uniting *uniting) {
    Fragment *fragments = uniting->fragments;
    for (int64_t i = 0; i < uniting->fragment_count; i++) {
        const Edge *edge = uniting->edges + fragments[i].edge;
        const Convex *polygon = uniting->polygons + edge->polygon;
        bool is_end = fragments[i].before == NONE;
        int64_t on = fragments[i].before, after = fragments[i].edge;
        if (is_end) on = after + 1 < polygon->end ? after + 1 : polygon->first, after = NONE;
        for (int64_t k = 0; k < uniting->fragment_count; k++) {
            if (fragments[k].edge != on || fragments[k].after != after) continue;
            fragments[i].next = k;
            break;
        }
        if (fragments[i].next == NONE) return false;
    }
    return true;
}

/* Append the cycles of fragments that are shells, or holes; false if a fragment is in two. */
static bool add_cycles(Uniting *uniting, bool holes, Rings *found) {
    for (int64_t i = 0; i < uniting->fragment_count; i++) {
        if (uniting->fragments[i].edge == NONE) continue;
        int64_t first = found->vertices, at = i;
        double around = 0.0;
        do {
            const Fragment *fragment = uniting->fragments + at;
            if (found->vertices - first == uniting->fragment_count) return false;
            rings_add(found, fragment->start[0], fragment->start[1]);
            at = fragment->next;
            const double *next = uniting->fragments[at].start;
            around += hypot(next[0] - fragment->start[0], next[1] - fragment->start[1]);
        } while (at != i);
        double twice = ring_doubled_area((const double (*)[2])(found->vertex + first), found->vertices - first);
        bool is_hole = twice < 0.0, is_narrow = is_hole && -twice < NARROW_M * around;
        if (is_hole != holes || is_narrow) {
            found->vertices = first;
            continue;
        }
        for (at = i; uniting->fragments[at].edge != NONE; at = uniting->fragments[at].next) uniting->fragments[at].edge = NONE;
        if (at != i) return false;
        rings_end(found, is_hole);
    }
    return true;
}

bool unite(Uniting *uniting, const double *ring, const int64_t *ring_offset, int64_t count, Rings *found, bool *has_memory) {
    uniting->edge_count = uniting->fragment_count = 0;
    *has_memory = make_room(uniting, 2 * (ring_offset[count] - ring_offset[0]), count);
    if (!*has_memory) return false;
    for (int64_t i = 0; i < count; i++) {
        double grown_m = LEAST_GROWN_M * (1.0 + (double)i / (double)count);
        add_polygon(uniting, i, ring + 2 * ring_offset[i], ring_offset[i + 1] - ring_offset[i] - 1, grown_m);
    }
    for (int64_t i = 0; i < uniting->edge_count && *has_memory; i++) *has_memory = add_fragments(uniting, i, count);
    *has_memory = *has_memory && rings_make_room(found, uniting->fragment_count, 2 * uniting->fragment_count);
    if (!*has_memory || !link_fragments(uniting)) return false;
    /* One shell, as nearly always, contains all holes. */
    if (!add_cycles(uniting, false, found)) return false;
    int64_t shells = found->count;
    if (!add_cycles(uniting, true, found)) return false;
    return shells > 0 && (shells == 1 || found->count == shells);
}
