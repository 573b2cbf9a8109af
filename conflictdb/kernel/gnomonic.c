/* How near points on the sphere are to arcs of great circles, from gnomonic coordinates. Of two arcs that do not cross,
 * one has an end that is nearest to the other.
 *
 * A place (x, y), in radii, is in the direction (x, y, 1). Everything is written in differences of coordinates, so that
 * nothing cancels: the cross product of two such vectors is (dy, -dx, x dy - y dx).
 */
#include <math.h>

#include "plane.h"
#include "runs.h"

static double dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y; }
static Vector minus(Vector a, Vector b) { return (Vector){a.x - b.x, a.y - b.y}; }

/* The squared length of (base, 1) x (base + step, 1). */
static double sine2(Vector base, Vector step) {
    double area = base.x * step.y - base.y * step.x;
    return dot(step, step) + area * area;
}

/* The scalar product of two steps, as the sphere has it at their base. */
static double metric(Vector base, Vector one, Vector other) {
    return (1.0 + dot(base, base)) * dot(one, other) - dot(base, one) * dot(base, other);
}

/* The squared chord of an angle, 2 - 2 cos, without cancellation. */
static double chord2(double sine_squared, double cosine) {
    return cosine < 0.0 ? 2.0 - 2.0 * cosine : 2.0 * sine_squared / (1.0 + cosine);
}

/* point, to_point: the point, and its way from the start of the arc; edge: the way along the arc. */
static double squared_chord(Vector point, Vector start, Vector to_point, Vector edge) {
    Vector end = {start.x + edge.x, start.y + edge.y}, to_next = minus(to_point, edge);
    double square = 1.0 + dot(start, start), point_square = 1.0 + dot(point, point), cosine = 1.0 + dot(start, point);
    double chord = chord2(sine2(start, to_point) / (square * point_square), cosine / sqrt(square * point_square));
    /* Within the arc: in front of either end, by the metric there. */
    if (!(metric(start, to_point, edge) > 0.0) || !(metric(end, to_next, (Vector){-edge.x, -edge.y}) > 0.0)) return chord;
    double area = edge.x * to_point.y - edge.y * to_point.x, normal = sine2(start, edge);
    double to_edge = area * area / (normal * point_square), edge_cosine = sqrt(most(1.0 - to_edge, 0.0));
    if (to_edge > 0.5) {
        /* The cosine of nearly a quarter turn is lost in its sine: |(start x end) x point| has it. */
        double ahead = dot(edge, point), x = edge.x * cosine - start.x * ahead, y = edge.y * cosine - start.y * ahead;
        edge_cosine = sqrt((x * x + y * y + ahead * ahead) / (normal * point_square));
    }
    return least(chord2(to_edge, edge_cosine), chord);
}

/* The least squared chord between vertices of one polygon and sides of another that is found. */
typedef struct {
    Vector origin;
    double radius_m, scale, square;
    Facing *facing;
} Chords;

static double metres_of(const Chords *chords) { return chords->radius_m * 2.0 * asin(least(0.5 * sqrt(chords->square), 1.0)); }

/* What spans more at the largest scale, and a little for rounding, is no nearer. */
static double look_chords(void *of, const Polygon *vertices, Range range, const Polygon *sides, Range among) {
    Chords *chords = of;
    double radius_m = chords->radius_m;
    Vector origin = chords->origin;
    for (int64_t i = range.first; i < range.end; i++)
        for (int64_t k = among.first; k < among.end; k++) {
            int64_t m = edge_end(sides, k);
            Vector own = {vertices->x[i], vertices->y[i]}, from = {sides->x[k], sides->y[k]};
            Vector way = {(own.x - from.x) / radius_m, (own.y - from.y) / radius_m};
            Vector edge = {(sides->x[m] - from.x) / radius_m, (sides->y[m] - from.y) / radius_m};
            Vector point = {(own.x + origin.x) / radius_m, (own.y + origin.y) / radius_m};
            Vector start = {(from.x + origin.x) / radius_m, (from.y + origin.y) / radius_m};
            double found = squared_chord(point, start, way, edge);
            if (found < chords->square) chords->square = found, *chords->facing = (Facing){vertices, sides, i, k, NAN};
        }
    return metres_of(chords) * chords->scale * (1.0 + 1e-9) + 1e-6;
}

double gnomonic_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, Facing *facing) {
    Extent extent = extent_none();
    extent_add(&extent, a, origin), extent_add(&extent, b, origin);
    Chords chords = {origin, plane->radius_m, plane_largest_scale(plane, &extent), INFINITY, facing};
    runs_visit(a, b, INFINITY, look_chords, &chords);
    return metres_of(&chords);
}

double gnomonic_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin) {
    double radius_m = plane->radius_m;
    Vector point = {(one.x + origin.x) / radius_m, (one.y + origin.y) / radius_m};
    Vector start = {(other.x + origin.x) / radius_m, (other.y + origin.y) / radius_m};
    Vector way = {(one.x - other.x) / radius_m, (one.y - other.y) / radius_m};
    return radius_m * 2.0 * asin(least(0.5 * sqrt(squared_chord(point, start, way, (Vector){0.0, 0.0})), 1.0));
}
