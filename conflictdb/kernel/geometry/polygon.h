/* Two convex polygons at an instant: distances in the plane. Plane metres.
 *
 * The signed separation is the distance of polygons that are apart; minus the depth of the shallowest escape of those
 * that overlap (separating axes).
 */
#ifndef CONFLICTDB_POLYGON_H
#define CONFLICTDB_POLYGON_H

#include <stdbool.h>
#include <stdint.h>

#include "require.h"

typedef struct {
    double x, y;
} Vector;

/* At least one vertex; edges lead from each vertex to the next. For a large polygon in runs (runs.h): how far each run
 * bends, and the largest coordinate. */
typedef struct {
    double *x, *y;
    int64_t count;
    bool is_in_runs;
    double *bends, largest;
} Polygon;

/* A gap, and its axis: the unit vector from the first to the second polygon along which it is measured. */
typedef struct {
    double gap;
    Vector axis;
} Gap;

/* The vertex at which the edge from vertex k ends; for a point, itself. */
static inline int64_t edge_end(const Polygon *polygon, int64_t k) {
    REQUIRE(k >= 0 && k < polygon->count);
    return k + 1 < polygon->count ? k + 1 : 0;
}

/* The smallest projection of the vertices onto a vector. NaN vertices after the first are skipped. */
static inline double least_along(double nx, double ny, const Polygon *polygon) {
    REQUIRE(polygon->count > 0);
    const double *x = polygon->x, *y = polygon->y;
    double least = nx * x[0] + ny * y[0];
    for (int64_t j = 1; j < polygon->count; j++) {
        double along = nx * x[j] + ny * y[j];
        least = along < least ? along : least;
    }
    return least;
}

static inline double most_along(double nx, double ny, const Polygon *polygon) { return -least_along(-nx, -ny, polygon); }

/* The largest projection of a convex polygon onto the normal of its own edge from vertex k. */
static inline double own_reach(double nx, double ny, const Polygon *mine, int64_t k) {
    if (mine->count > 2) return nx * mine->x[k] + ny * mine->y[k];
    return most_along(nx, ny, mine);
}

/* min of b minus max of a along an axis. */
static inline double gap_along(Vector axis, const Polygon *a, const Polygon *b) {
    return least_along(axis.x, axis.y, b) - most_along(axis.x, axis.y, a);
}

/* For convex, counter-clockwise polygons. Two polygons in runs take at most n log n steps, others n m; both results
 * differ by the rounding of projections only. */

/* The widest gap along the normals of the edges: its sign is that of the separation. NaN if neither polygon has an
 * edge. */
Gap polygon_separation(const Polygon *a, const Polygon *b);

/* The distance of polygons that are apart; else the widest gap, with the line between their middles as a further axis.
 * from, to: nearest points of a and b if apart, else the middles of their vertices. */
Gap polygon_distance(const Polygon *a, const Polygon *b, Vector *from, Vector *to);

/* The nearest points of the outlines of a and b, which do not cross; returns their distance. */
double polygon_nearest(const Polygon *a, const Polygon *b, Vector *from, Vector *to);

/* The part of a polygon left of the line from `start` along `way`, in the order of its vertices. False if it does not
 * fit; for a convex polygon it has at most one vertex more. */
bool polygon_clip(const Polygon *polygon, Vector start, Vector way, Polygon *kept, int64_t room);

/* The intersection of two polygons, at least one with an inside. Returns room or spare, each for two vertices more than
 * both have. Takes (sides of one) x (vertices of both) steps: half a second for two circles of 16,000 vertices. */
Polygon *polygon_common(const Polygon *a, const Polygon *b, Polygon *room, Polygon *spare);

/* A common point of two polygons that overlap or touch: the centroid of their intersection. room, spare: each for two
 * vertices more than both have. */
Vector polygon_common_point(const Polygon *a, const Polygon *b, Polygon *room, Polygon *spare);

/* Squared distance of a point from an edge; way: from the start of the edge to the point. */
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

/* Replace a polygon by its convex hull, counter-clockwise. spare: room for twice as many vertices. */
void polygon_hull(Polygon *polygon, Polygon *spare);

#endif
