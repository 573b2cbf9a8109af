/* Distances on the sphere between vertices and arcs of great circles, from gnomonic coordinates. For two arcs that do
 * not cross, an end of one is nearest to the other.
 *
 * A place (x, y), in radii, has the direction (x, y, 1). All formulas use differences of coordinates, so nothing
 * cancels: the cross product of two such vectors is (dy, -dx, x dy - y dx).
 */
#include <math.h>

#include "planes/plane.h"

/* A thousand times the rounding error of chords of the unit sphere. */
static const double CHORD_ROUNDING = 1e-12;
/* Vertices times sides that are compared one by one. Smaller: small polygons take longer; larger: large ones do. */
enum { MOST_LOOKS = 256 };

static double dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y; }
static Vector minus(Vector a, Vector b) { return (Vector){a.x - b.x, a.y - b.y}; }

/* Squared length of (base, 1) x (base + step, 1). */
static double sine2(Vector base, Vector step) {
    double area = base.x * step.y - base.y * step.x;
    return dot(step, step) + area * area;
}

/* Scalar product of two steps in the metric of the sphere at their base. */
static double metric(Vector base, Vector one, Vector other) {
    return (1.0 + dot(base, base)) * dot(one, other) - dot(base, one) * dot(base, other);
}

/* Squared chord of an angle, 2 - 2 cos, without cancellation. */
static double chord2(double sine_squared, double cosine) {
    return cosine < 0.0 ? 2.0 - 2.0 * cosine : 2.0 * sine_squared / (1.0 + cosine);
}

/* to_point: from the start of the arc to the point; edge: from the start to the end of the arc. */
static double squared_chord(Vector point, Vector start, Vector to_point, Vector edge) {
    Vector end = {start.x + edge.x, start.y + edge.y}, to_next = minus(to_point, edge);
    double square = 1.0 + dot(start, start), point_square = 1.0 + dot(point, point), cosine = 1.0 + dot(start, point);
    double chord = chord2(sine2(start, to_point) / (square * point_square), cosine / sqrt(square * point_square));
    /* The foot lies within the arc if the point lies ahead of both ends, in the metric there. */
    if (!(metric(start, to_point, edge) > 0.0) || !(metric(end, to_next, (Vector){-edge.x, -edge.y}) > 0.0)) return chord;
    double area = edge.x * to_point.y - edge.y * to_point.x, normal = sine2(start, edge);
    double to_edge = area * area / (normal * point_square), edge_cosine = sqrt(most(1.0 - to_edge, 0.0));
    if (to_edge > 0.5) {
        /* Near a quarter turn the cosine is lost in the sine; compute it as |(start x end) x point|. */
        double ahead = dot(edge, point), x = edge.x * cosine - start.x * ahead, y = edge.y * cosine - start.y * ahead;
        edge_cosine = sqrt((x * x + y * y + ahead * ahead) / (normal * point_square));
    }
    return least(chord2(to_edge, edge_cosine), chord);
}

/* State of the search for the smallest squared chord between a vertex and a side. */
typedef struct {
    Vector origin;
    double radius_m, square;
    Facing *facing;
} Chords;

/* A range of vertices of a polygon, or of sides by their starts. The ball about (x, y, z) contains their unit vectors
 * and what lies between. */
typedef struct {
    const Polygon *polygon;
    int64_t first, end;
    double x, y, z, radius;
} Some;

static double chord_of(const Some *a, const Some *b) {
    double x = b->x - a->x, y = b->y - a->y, z = b->z - a->z;
    return sqrt(x * x + y * y + z * z);
}

static Some one_of(const Chords *chords, const Polygon *polygon, int64_t i) {
    double x = (polygon->x[i] + chords->origin.x) / chords->radius_m, y = (polygon->y[i] + chords->origin.y) / chords->radius_m;
    double length = sqrt(1.0 + x * x + y * y);
    return (Some){polygon, i, i + 1, x / length, y / length, 1.0 / length, 0.0};
}

static Some some_of(const Chords *chords, const Polygon *polygon, int64_t first, int64_t end) {
    Some some = one_of(chords, polygon, first + (end - first) / 2);
    for (int64_t i = first; i <= end; i++) {
        Some one = one_of(chords, polygon, i < polygon->count ? i : 0);
        some.radius = most(some.radius, chord_of(&some, &one));
    }
    some.first = first, some.end = end;
    return some;
}

/* Lower bound on the chord between ranges. Balls of radius below 1 contain the arcs of their points. */
static double apart(const Some *a, const Some *b) {
    return a->radius < 1.0 && b->radius < 1.0 ? chord_of(a, b) - a->radius - b->radius : -INFINITY;
}

static void look_at(Chords *chords, const Polygon *vertices, int64_t i, const Polygon *sides, int64_t k) {
    double radius_m = chords->radius_m;
    Vector origin = chords->origin;
    int64_t m = edge_end(sides, k);
    Vector own = {vertices->x[i], vertices->y[i]}, from = {sides->x[k], sides->y[k]};
    Vector way = {(own.x - from.x) / radius_m, (own.y - from.y) / radius_m};
    Vector edge = {(sides->x[m] - from.x) / radius_m, (sides->y[m] - from.y) / radius_m};
    Vector point = {(own.x + origin.x) / radius_m, (own.y + origin.y) / radius_m};
    Vector start = {(from.x + origin.x) / radius_m, (from.y + origin.y) / radius_m};
    double found = squared_chord(point, start, way, edge);
    if (found < chords->square) chords->square = found, *chords->facing = (Facing){vertices, sides, i, k, NAN};
}

/* Inspect what may be nearer than the smallest chord: halve the larger range, the nearer half first. */
static void look_closer(Chords *chords, const Some *vertices, const Some *sides) {
    int64_t count = vertices->end - vertices->first, side_count = sides->end - sides->first;
    if (count * side_count <= MOST_LOOKS) {
        for (int64_t i = vertices->first; i < vertices->end; i++)
            for (int64_t k = sides->first; k < sides->end; k++) look_at(chords, vertices->polygon, i, sides->polygon, k);
        return;
    }
    const Some *larger = count > side_count ? vertices : sides, *other = count > side_count ? sides : vertices;
    int64_t middle = larger->first + (larger->end - larger->first) / 2;
    Some halves[2] = {some_of(chords, larger->polygon, larger->first, middle),
                      some_of(chords, larger->polygon, middle, larger->end)};
    double gaps[2] = {apart(&halves[0], other), apart(&halves[1], other)};
    int nearer = gaps[1] < gaps[0];
    for (int k = 0; k < 2; k++) {
        int next = k == 0 ? nearer : !nearer;
        if (gaps[next] > sqrt(chords->square) + CHORD_ROUNDING) continue;
        if (larger == vertices) look_closer(chords, &halves[next], sides);
        else look_closer(chords, vertices, &halves[next]);
    }
}

double gnomonic_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, Facing *facing) {
    Chords chords = {origin, plane->radius_m, INFINITY, facing};
    Some of_a = {.polygon = a, .end = a->count, .radius = INFINITY}, of_b = {.polygon = b, .end = b->count, .radius = INFINITY};
    look_closer(&chords, &of_a, &of_b);
    look_closer(&chords, &of_b, &of_a);
    return plane->radius_m * 2.0 * asin(least(0.5 * sqrt(chords.square), 1.0));
}

double gnomonic_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin) {
    double radius_m = plane->radius_m;
    Vector point = {(one.x + origin.x) / radius_m, (one.y + origin.y) / radius_m};
    Vector start = {(other.x + origin.x) / radius_m, (other.y + origin.y) / radius_m};
    Vector way = {(one.x - other.x) / radius_m, (one.y - other.y) / radius_m};
    return radius_m * 2.0 * asin(least(0.5 * sqrt(squared_chord(point, start, way, (Vector){0.0, 0.0})), 1.0));
}
