#include "geometry/polygon.h"

#include <math.h>

#include "geometry/runs.h"

/* A polygon is a sliver if it covers less than this fraction of its squared length. Smaller: rounding decides where its
 * centroid is. */
static const double SLIVER = 1e-8;

/* Widen a gap by those along the normals of one polygon's edges. sign: 1 if `mine` is the first polygon. */
static void widen_by_edges(Gap *widest, const Polygon *mine, const Polygon *other, double sign) {
    Ahead ahead = ahead_of(mine, other);
    for (int64_t step = ahead.step; step > 0; step = finer(step))
        for (int64_t k = 0; k < mine->count; k += step) {
            int64_t m = edge_end(mine, k);
            double nx = mine->y[m] - mine->y[k], ny = mine->x[k] - mine->x[m], square = nx * nx + ny * ny;
            if (!(square > 0.0)) continue; /* coincident vertices have no edge */
            double length = sqrt(square), own = own_reach(nx, ny, mine, k);
            if (ahead.is_in_runs && (ahead_at(nx, ny, &ahead) - own) / length <= widest->gap) continue;
            double gap = (ahead_along(nx, ny, &ahead) - own) / length;
            if (gap > widest->gap) *widest = (Gap){gap, {sign * nx / length, sign * ny / length}};
        }
}

Gap polygon_separation(const Polygon *a, const Polygon *b) {
    REQUIRE(a->count > 0 && b->count > 0);
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

/* A polygon of two vertices is a line: its direction may separate it from what lies ahead of it. */
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

/* A vertex and a side, by index, and their squared distance. */
typedef struct {
    double square;
    int64_t vertex, side;
} Nearest;

static Vector side_of(const Polygon *polygon, int64_t k) {
    int64_t m = edge_end(polygon, k);
    return (Vector){polygon->x[m] - polygon->x[k], polygon->y[m] - polygon->y[k]};
}

/* The nearest pair of a's vertices and b's sides, and of b's vertices and a's sides. */
typedef struct {
    const Polygon *a;
    Nearest of_a, of_b;
} Nearer;

static double look_nearer(void *of, const Polygon *vertices, Range range, const Polygon *sides, Range among) {
    Nearer *nearer = of;
    Nearest *kept = vertices == nearer->a ? &nearer->of_a : &nearer->of_b, nearest = *kept;
    for (int64_t k = among.first; k < among.end; k++) {
        Vector side = side_of(sides, k);
        for (int64_t i = range.first; i < range.end; i++) {
            Vector way = {vertices->x[i] - sides->x[k], vertices->y[i] - sides->y[k]};
            double square = squared_distance(way, side);
            if (square < nearest.square) nearest = (Nearest){square, i, k};
        }
    }
    *kept = nearest;
    if (!vertices->is_in_runs) return INFINITY;
    return sqrt(nearer->of_a.square < nearer->of_b.square ? nearer->of_a.square : nearer->of_b.square);
}

/* The vertex, and the nearest point of the side. */
static void points_of(const Polygon *vertices, const Polygon *sides, Nearest nearest, Vector *vertex, Vector *on) {
    Vector side = side_of(sides, nearest.side), start = {sides->x[nearest.side], sides->y[nearest.side]};
    *vertex = (Vector){vertices->x[nearest.vertex], vertices->y[nearest.vertex]};
    double square = side.x * side.x + side.y * side.y;
    double along = ((vertex->x - start.x) * side.x + (vertex->y - start.y) * side.y) / (square > 0.0 ? square : 1.0);
    along = along < 0.0 ? 0.0 : along > 1.0 ? 1.0 : along;
    *on = (Vector){start.x + along * side.x, start.y + along * side.y};
}

double polygon_nearest(const Polygon *a, const Polygon *b, Vector *from, Vector *to) {
    REQUIRE(a->count > 0 && b->count > 0);
    Nearer nearer = {a, {INFINITY, 0, 0}, {INFINITY, 0, 0}};
    runs_visit(a, b, INFINITY, look_nearer, &nearer);
    bool is_of_a = nearer.of_a.square <= nearer.of_b.square;
    if (is_of_a) points_of(a, b, nearer.of_a, from, to);
    else points_of(b, a, nearer.of_b, to, from);
    return sqrt(is_of_a ? nearer.of_a.square : nearer.of_b.square);
}

Gap polygon_distance(const Polygon *a, const Polygon *b, Vector *from, Vector *to) {
    REQUIRE(a->count > 0 && b->count > 0);
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
    double distance = polygon_nearest(a, b, from, to);
    if (!(distance > 0.0)) return widest;
    /* The line between close points hardly has a direction: then an edge's normal separates better. */
    Vector way = {(to->x - from->x) / distance, (to->y - from->y) / distance};
    if (gap_along(way, a, b) > widest.gap) widest.axis = way;
    widest.gap = distance;
    return widest;
}

bool polygon_clip(const Polygon *polygon, Vector start, Vector way, Polygon *kept, int64_t room) {
    kept->count = 0;
    for (int64_t i = 0; i < polygon->count; i++) {
        if (kept->count + 2 > room) return false;
        int64_t j = edge_end(polygon, i);
        double here = way.x * (polygon->y[i] - start.y) - way.y * (polygon->x[i] - start.x);
        double there = way.x * (polygon->y[j] - start.y) - way.y * (polygon->x[j] - start.x);
        if (here >= 0.0) kept->x[kept->count] = polygon->x[i], kept->y[kept->count++] = polygon->y[i];
        if ((here < 0.0 && there > 0.0) || (here > 0.0 && there < 0.0)) {
            double share = here / (here - there);
            kept->x[kept->count] = polygon->x[i] + share * (polygon->x[j] - polygon->x[i]);
            kept->y[kept->count++] = polygon->y[i] + share * (polygon->y[j] - polygon->y[i]);
        }
    }
    return true;
}

/* The centroid; for a sliver, the middle of its box. Areas are relative to the first vertex, to keep digits. */
static Vector centroid(const Polygon *polygon) {
    double x0 = polygon->x[0], y0 = polygon->y[0], west = 0.0, east = 0.0, south = 0.0, north = 0.0;
    double area = 0.0, sum_x = 0.0, sum_y = 0.0;
    for (int64_t i = 1; i < polygon->count; i++) {
        double x = polygon->x[i] - x0, y = polygon->y[i] - y0;
        double before_x = polygon->x[i - 1] - x0, before_y = polygon->y[i - 1] - y0, twice = before_x * y - before_y * x;
        area += twice, sum_x += twice * (before_x + x), sum_y += twice * (before_y + y);
        west = fmin(west, x), east = fmax(east, x), south = fmin(south, y), north = fmax(north, y);
    }
    double width = east - west, height = north - south;
    if (area > SLIVER * (width * width + height * height))
        return (Vector){x0 + sum_x / (3.0 * area), y0 + sum_y / (3.0 * area)};
    return (Vector){x0 + 0.5 * (west + east), y0 + 0.5 * (south + north)};
}

/* The intersection of two lines, or the middle between their nearest points. */
static Vector crossing_of(const Polygon *a, const Polygon *b) {
    Vector of_a = side_of(a, 0), of_b = side_of(b, 0), from, to;
    double turn = of_a.x * of_b.y - of_a.y * of_b.x;
    double part = ((b->x[0] - a->x[0]) * of_b.y - (b->y[0] - a->y[0]) * of_b.x) / turn;
    if (part >= 0.0 && part <= 1.0) return (Vector){a->x[0] + part * of_a.x, a->y[0] + part * of_a.y};
    polygon_nearest(a, b, &from, &to);
    return (Vector){0.5 * (from.x + to.x), 0.5 * (from.y + to.y)};
}

/* I. E. Sutherland, G. W. Hodgman, "Reentrant polygon clipping", Commun. ACM 17 (1974), doi:10.1145/360767.360802. */
Polygon *polygon_common(const Polygon *a, const Polygon *b, Polygon *room, Polygon *spare) {
    REQUIRE(a->count > 2 || b->count > 2 || (a->count > 0 && b->count > 0));
    const Polygon *whole = b->count < 3 ? b : a, *edges = b->count < 3 ? a : b;
    Polygon *kept = room, *next = spare;
    int64_t most = a->count + b->count + 2;
    kept->count = whole->count;
    for (int64_t i = 0; i < whole->count; i++) kept->x[i] = whole->x[i], kept->y[i] = whole->y[i];
    for (int64_t k = 0; k < edges->count && kept->count > 0; k++) {
        Polygon *before = kept;
        if (!polygon_clip(kept, (Vector){edges->x[k], edges->y[k]}, side_of(edges, k), next, most)) break;
        kept = next, next = before;
    }
    return kept;
}

Vector polygon_common_point(const Polygon *a, const Polygon *b, Polygon *room, Polygon *spare) {
    if (a->count < 3 && b->count < 3) return crossing_of(a, b);
    const Polygon *common = polygon_common(a, b, room, spare);
    if (common->count > 0) return centroid(common);
    /* They touch, to rounding. */
    Vector from, to;
    polygon_nearest(a, b, &from, &to);
    return (Vector){0.5 * (from.x + to.x), 0.5 * (from.y + to.y)};
}

static bool is_before(const Polygon *polygon, int64_t i, int64_t j) {
    return polygon->x[i] < polygon->x[j] || (polygon->x[i] == polygon->x[j] && polygon->y[i] < polygon->y[j]);
}

static void swap(Polygon *polygon, int64_t i, int64_t j) {
    double x = polygon->x[i], y = polygon->y[i];
    polygon->x[i] = polygon->x[j], polygon->y[i] = polygon->y[j];
    polygon->x[j] = x, polygon->y[j] = y;
}

/* Heap sort: let vertex i sink below its larger children. */
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

/* Add vertex i to a hull chain that turns left, of which the first `fixed` vertices stay. */
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
 * doi:10.1016/0020-0190(79)90072-3. Vertices dropped by rounding lie outside by less than 1e-16 of the polygon's size.
 */
void polygon_hull(Polygon *polygon, Polygon *spare) {
    REQUIRE(polygon->count > 0);
    sort_vertices(polygon);
    spare->count = 0;
    for (int64_t i = 0; i < polygon->count; i++) add_to_chain(spare, 1, polygon, i);
    int64_t lower = spare->count; /* and at most as many for the upper chain */
    for (int64_t i = polygon->count - 2; i >= 0; i--) add_to_chain(spare, lower, polygon, i);
    /* The first vertex was added again, unless it is the only one. */
    polygon->count = spare->count > 1 ? spare->count - 1 : 1;
    for (int64_t i = 0; i < polygon->count; i++) polygon->x[i] = spare->x[i], polygon->y[i] = spare->y[i];
}
