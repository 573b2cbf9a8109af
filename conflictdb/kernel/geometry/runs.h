/* Large polygons as runs of sides, runs of runs and so on, so that not every side is compared with every vertex. Plane
 * metres.
 *
 * The bend of a run is the largest distance of its vertices from its chord. It shrinks with the square of the length
 * for a smooth outline, so extreme or near vertices are in few runs of each length. Outlines need not be convex.
 */
#ifndef CONFLICTDB_RUNS_H
#define CONFLICTDB_RUNS_H

#include "geometry/polygon.h"

/* Most bends of a polygon of `count` vertices. */
static inline int64_t runs_room(int64_t count) { return count / 16 + 16; }

/* Divide two polygons into runs if both are large: otherwise comparing all sides takes less time. */
void runs_make(Polygon *a, Polygon *b);

/* The smallest projection of vertices onto a vector, and its vertex; within SLACK (runs.c) of the largest coordinate.
 */
double runs_least_along(double nx, double ny, const Polygon *polygon, int64_t *vertex);

/* Projections of another polygon onto edge normals. For two polygons in runs: the vertex nearest at the last edge,
 * which rules out most edges; some edges, `step` apart, come first. */
typedef struct {
    const Polygon *other;
    bool is_in_runs;
    int64_t step, vertex;
} Ahead;

static inline Ahead ahead_of(const Polygon *mine, const Polygon *other) {
    bool is_in_runs = mine->is_in_runs && other->is_in_runs;
    return (Ahead){other, is_in_runs, is_in_runs ? 64 : 1, 0};
}

static inline int64_t finer(int64_t step) { return step > 1 ? 1 : 0; }

/* An upper bound on the other polygon's smallest projection onto a vector, and its exact value. */
static inline double ahead_at(double nx, double ny, const Ahead *ahead) {
    return nx * ahead->other->x[ahead->vertex] + ny * ahead->other->y[ahead->vertex];
}

static inline double ahead_along(double nx, double ny, Ahead *ahead) {
    if (!ahead->is_in_runs) return least_along(nx, ny, ahead->other);
    int64_t vertex; /* a local copy: the compiler would reload a shared one for every edge */
    double found = runs_least_along(nx, ny, ahead->other, &vertex);
    ahead->vertex = vertex;
    return found;
}

/* Vertices [first, end) of a polygon, cyclic. */
typedef struct {
    int64_t first, end;
} Range;

/* Callback: inspect ranges of vertices of one polygon and sides of another. Returns the distance within which others
 * matter. */
typedef double Look(void *of, const Polygon *vertices, Range i, const Polygon *sides, Range k);

/* Call `look` for all vertices and sides of two polygons (a's vertices first) that may be within `reach` of each other,
 * to SLACK of the largest coordinate. More may be passed. */
void runs_visit(const Polygon *a, const Polygon *b, double reach, Look *look, void *of);

#endif
