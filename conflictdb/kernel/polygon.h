/* Two convex polygons at an instant: how far apart they are in the plane. Plane metres.
 *
 * The signed separation is their distance where they are apart, and minus the depth of the shallowest way out where
 * they overlap (separating axes).
 */
#ifndef CONFLICTDB_POLYGON_H
#define CONFLICTDB_POLYGON_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    double x, y;
} Vector;

/* At least one vertex; the edges run from each to the next. bends, largest: of a large one that is in runs (runs.h), how
 * far each run bends, and the largest coordinate. */
typedef struct {
    double *x, *y;
    int64_t count;
    bool is_in_runs;
    double *bends, largest;
} Polygon;

/* A gap, and the unit vector from the first to the second polygon along which it is measured. */
typedef struct {
    double gap;
    Vector axis;
} Gap;

/* The vertex that the edge ends at which starts at vertex k; of a point, itself. */
static inline int64_t edge_end(const Polygon *polygon, int64_t k) { return k + 1 < polygon->count ? k + 1 : 0; }

/* The least that vertices reach along a vector; NaN of one vertex does not show. */
static inline double least_along(double nx, double ny, const Polygon *polygon) {
    const double *x = polygon->x, *y = polygon->y;
    double least = nx * x[0] + ny * y[0];
    for (int64_t j = 1; j < polygon->count; j++) {
        double along = nx * x[j] + ny * y[j];
        least = along < least ? along : least;
    }
    return least;
}

static inline double most_along(double nx, double ny, const Polygon *polygon) {
    return -least_along(-nx, -ny, polygon);
}

/* How far a convex polygon reaches along the normal of its own edge from vertex k. */
static inline double own_reach(double nx, double ny, const Polygon *mine, int64_t k) {
    if (mine->count > 2) return nx * mine->x[k] + ny * mine->y[k];
    return most_along(nx, ny, mine);
}

/* min of b less max of a along an axis. */
static inline double gap_along(Vector axis, const Polygon *a, const Polygon *b) {
    return least_along(axis.x, axis.y, b) - most_along(axis.x, axis.y, a);
}

/* Of convex polygons, counter-clockwise. Two that are in runs take n log n steps at most, others n times m; what either
 * finds differs by what rounding makes of reaches along an axis: */

/* The widest gap along the normals of the edges; its sign is that of the separation. NaN where neither has an edge. */
Gap polygon_separation(const Polygon *a, const Polygon *b);

/* The distance, where they are apart; else the widest gap, and the line between their middles counts as an axis too.
 * from, to: nearest points of a and b where they are apart, else the middles of their vertices. */
Gap polygon_distance(const Polygon *a, const Polygon *b, Vector *from, Vector *to);

/* The nearest points of the outlines of a and b, which do not cross; their distance. */
double polygon_nearest(const Polygon *a, const Polygon *b, Vector *from, Vector *to);

/* Which part of a polygon lies left of the line from `start` along `way`, in the order of its vertices; false where there
 * is no room for it, as that of a convex polygon has one vertex more at most. */
bool polygon_clip(const Polygon *polygon, Vector start, Vector way, Polygon *kept, int64_t room);

/* What two polygons have in common, one of which has an inside: room or spare, which are for two vertices more than both
 * have together. As many steps as the one has sides, times vertices of both: half a second for two circles of 16,000. */
Polygon *polygon_common(const Polygon *a, const Polygon *b, Polygon *room, Polygon *spare);

/* A point of both of two polygons that overlap or touch: the middle of what they have in common. room, spare: for two
 * vertices more than both have together. */
Vector polygon_common_point(const Polygon *a, const Polygon *b, Polygon *room, Polygon *spare);

/* The squared distance of a point from an edge; way: to the point from where the edge starts. */
static inline double squared_distance(Vector way, Vector edge) {
    double along = way.x * edge.x + way.y * edge.y, square = edge.x * edge.x + edge.y * edge.y;
    double x = way.x, y = way.y;
    if (along >= square) x -= edge.x, y -= edge.y;
    else if (along > 0.0) {
        double area = way.x * edge.y - way.y * edge.x;
        return area * area / square;
    }
    return x * x + y * y;
}

/* Leave of a polygon the corners of its convex hull, counter-clockwise. spare: room for twice as many vertices. */
void polygon_hull(Polygon *polygon, Polygon *spare);

#endif
