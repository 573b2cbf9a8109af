#include "polygon.h"

#include <math.h>

/* Take the gaps along the normals of one polygon's edges where they are wider. sign: 1 where `mine` is the first. */
static void widen_by_edges(Gap *widest, const Polygon *mine, const Polygon *other, double sign) {
    for (int64_t k = 0; k < mine->count; k++) {
        int64_t m = edge_end(mine, k);
        double nx = mine->y[m] - mine->y[k], ny = mine->x[k] - mine->x[m], square = nx * nx + ny * ny;
        if (!(square > 0.0)) continue; /* no edge between vertices that coincide */
        double length = sqrt(square);
        double gap = (least_along(nx, ny, other) - own_reach(nx, ny, mine, k)) / length;
        if (gap > widest->gap) *widest = (Gap){gap, {sign * nx / length, sign * ny / length}};
    }
}

Gap polygon_separation(const Polygon *a, const Polygon *b) {
    Gap widest = {-INFINITY, {0.0, 0.0}};
    widen_by_edges(&widest, a, b, 1.0);
    widen_by_edges(&widest, b, a, -1.0);
    if (widest.gap == -INFINITY) widest.gap = NAN;
    return widest;
}

static Vector middle_of(const Polygon *polygon) {
    Vector sum = {0.0, 0.0};
    for (int64_t i = 0; i < polygon->count; i++) sum.x += polygon->x[i], sum.y += polygon->y[i];
    return (Vector){sum.x / (double)polygon->count, sum.y / (double)polygon->count};
}

/* A polygon of two vertices is a line: its direction separates it from what lies ahead of it. */
static void widen_by_directions(Gap *widest, const Polygon *line, const Polygon *a, const Polygon *b) {
    for (int64_t k = 0; k < line->count; k++) {
        int64_t m = edge_end(line, k);
        double x = line->x[m] - line->x[k], y = line->y[m] - line->y[k], length = sqrt(x * x + y * y);
        if (!(length > 0.0)) continue;
        for (double sign = -1.0; sign <= 1.0; sign += 2.0) {
            Vector axis = {sign * x / length, sign * y / length};
            double gap = gap_along(axis, a, b);
            if (gap > widest->gap) *widest = (Gap){gap, axis};
        }
    }
}

/* A vertex and a side, by their numbers, and their squared distance. */
typedef struct {
    double square;
    int64_t vertex, side;
} Nearest;

static Vector side_of(const Polygon *polygon, int64_t k) {
    int64_t m = edge_end(polygon, k);
    return (Vector){polygon->x[m] - polygon->x[k], polygon->y[m] - polygon->y[k]};
}

static Nearest nearest_of(const Polygon *vertices, const Polygon *sides) {
    Nearest nearest = {INFINITY, 0, 0};
    for (int64_t k = 0; k < sides->count; k++) {
        Vector side = side_of(sides, k);
        for (int64_t i = 0; i < vertices->count; i++) {
            Vector way = {vertices->x[i] - sides->x[k], vertices->y[i] - sides->y[k]};
            double square = squared_distance(way, side);
            if (square < nearest.square) nearest = (Nearest){square, i, k};
        }
    }
    return nearest;
}

/* The vertex, and the nearest place on the side. */
static void points_of(const Polygon *vertices, const Polygon *sides, Nearest nearest, Vector *vertex, Vector *on) {
    Vector side = side_of(sides, nearest.side), start = {sides->x[nearest.side], sides->y[nearest.side]};
    *vertex = (Vector){vertices->x[nearest.vertex], vertices->y[nearest.vertex]};
    double square = side.x * side.x + side.y * side.y;
    double along = ((vertex->x - start.x) * side.x + (vertex->y - start.y) * side.y) / (square > 0.0 ? square : 1.0);
    along = along < 0.0 ? 0.0 : along > 1.0 ? 1.0 : along;
    *on = (Vector){start.x + along * side.x, start.y + along * side.y};
}

Gap polygon_distance(const Polygon *a, const Polygon *b, Vector *from, Vector *to) {
    *from = middle_of(a), *to = middle_of(b);
    double x = to->x - from->x, y = to->y - from->y, length = sqrt(x * x + y * y);
    Gap widest = {0.0, length > 0.0 ? (Vector){x / length, y / length} : (Vector){1.0, 0.0}};
    widest.gap = gap_along(widest.axis, a, b);
    widen_by_edges(&widest, a, b, 1.0);
    widen_by_edges(&widest, b, a, -1.0);
    if (a->count == 2 || b->count == 2) {
        widen_by_directions(&widest, a, a, b);
        widen_by_directions(&widest, b, a, b);
    }
    if (!(widest.gap > 0.0)) return widest;
    Nearest of_a = nearest_of(a, b), of_b = nearest_of(b, a);
    if (of_a.square <= of_b.square) points_of(a, b, of_a, from, to);
    else points_of(b, a, of_b, to, from);
    double distance = sqrt(of_a.square <= of_b.square ? of_a.square : of_b.square);
    if (!(distance > 0.0)) return widest;
    /* The way between points that are close has hardly a direction: then that of an edge separates better. */
    Vector way = {(to->x - from->x) / distance, (to->y - from->y) / distance};
    if (gap_along(way, a, b) > widest.gap) widest.axis = way;
    widest.gap = distance;
    return widest;
}

static bool is_before(const Polygon *polygon, int64_t i, int64_t j) {
    return polygon->x[i] < polygon->x[j] || (polygon->x[i] == polygon->x[j] && polygon->y[i] < polygon->y[j]);
}

static void swap(Polygon *polygon, int64_t i, int64_t j) {
    double x = polygon->x[i], y = polygon->y[i];
    polygon->x[i] = polygon->x[j], polygon->y[i] = polygon->y[j];
    polygon->x[j] = x, polygon->y[j] = y;
}

/* Let vertex i of a heap of so many sink to its place: none is before its children. */
static void sink(Polygon *heap, int64_t i, int64_t count) {
    for (int64_t child = 2 * i + 1; child < count; i = child, child = 2 * i + 1) {
        if (child + 1 < count && is_before(heap, child, child + 1)) child++;
        if (!is_before(heap, i, child)) return;
        swap(heap, i, child);
    }
}

static void sort_vertices(Polygon *polygon) {
    for (int64_t i = polygon->count / 2 - 1; i >= 0; i--) sink(polygon, i, polygon->count);
    for (int64_t last = polygon->count - 1; last > 0; last--) {
        swap(polygon, 0, last);
        sink(polygon, 0, last);
    }
}

/* Add vertex i to a chain of a hull that turns left, of which at least `fixed` stay. */
static void add_to_chain(Polygon *chain, int64_t fixed, const Polygon *polygon, int64_t i) {
    double x = polygon->x[i], y = polygon->y[i];
    for (; chain->count > fixed; chain->count--) {
        int64_t last = chain->count - 1;
        double ax = chain->x[last] - chain->x[last - 1], ay = chain->y[last] - chain->y[last - 1];
        if (ax * (y - chain->y[last]) - ay * (x - chain->x[last]) > 0.0) break;
    }
    chain->x[chain->count] = x, chain->y[chain->count++] = y;
}

/* A. M. Andrew, "Another efficient algorithm for convex hulls in two dimensions", Inf. Process. Lett. 9 (1979),
 * doi:10.1016/0020-0190(79)90072-3. What rounding leaves out lies out by less than 1e-16 of the polygon's size. */
void polygon_hull(Polygon *polygon, Polygon *spare) {
    sort_vertices(polygon);
    spare->count = 0;
    for (int64_t i = 0; i < polygon->count; i++) add_to_chain(spare, 1, polygon, i);
    int64_t lower = spare->count; /* and as many for the upper chain at most */
    for (int64_t i = polygon->count - 2; i >= 0; i--) add_to_chain(spare, lower, polygon, i);
    /* The first vertex was added again, unless it is the only one. */
    polygon->count = spare->count > 1 ? spare->count - 1 : 1;
    for (int64_t i = 0; i < polygon->count; i++) polygon->x[i] = spare->x[i], polygon->y[i] = spare->y[i];
}
