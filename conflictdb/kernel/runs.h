/* Large polygons in runs of sides, runs of runs and so on, so that not every side meets every vertex. Plane metres.
 *
 * Of each run its bend is known: how far its vertices are from its chord at most. A run of a smooth outline bends with the
 * square of its length: what is extreme, or near, is in few runs of every length. Nothing needs outlines to be convex.
 */
#ifndef CONFLICTDB_RUNS_H
#define CONFLICTDB_RUNS_H

#include "polygon.h"

/* Bends that a polygon of so many vertices has at most. */
static inline int64_t runs_room(int64_t count) { return count / 16 + 16; }

/* Put two polygons in runs if both are large: the sides of a large one and the few of another take less time as they are. */
void runs_make(Polygon *a, Polygon *b);

/* The least that vertices reach along a vector, and the vertex that does: to SLACK (runs.c) of the largest coordinate where
 * several reach as far but for rounding. */
double runs_least_along(double nx, double ny, const Polygon *polygon, int64_t *vertex);

/* What lies ahead of the edges of a polygon: another, and of two in runs the vertex of it that was nearest last,
 * which tells of most edges that they need not be looked at closer. Some edges, `step` apart, come before all others. */
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

/* How far the other polygon reaches along a vector at most, and exactly. */
static inline double ahead_at(double nx, double ny, const Ahead *ahead) {
    return nx * ahead->other->x[ahead->vertex] + ny * ahead->other->y[ahead->vertex];
}

static inline double ahead_along(double nx, double ny, Ahead *ahead) {
    if (!ahead->is_in_runs) return least_along(nx, ny, ahead->other);
    int64_t vertex; /* of its own: what others may write to is read again for every edge */
    double found = runs_least_along(nx, ny, ahead->other, &vertex);
    ahead->vertex = vertex;
    return found;
}

/* Of vertices [first, end) of a polygon; beyond its last one its first comes. */
typedef struct {
    int64_t first, end;
} Range;

/* Look at some vertices of one polygon and some sides of another. Return within what distance others matter. */
typedef double Look(void *of, const Polygon *vertices, Range i, const Polygon *sides, Range k);

/* Let all vertices and sides of two polygons be looked at, of a and b first, that may be within reach of each other; not
 * those that are apart by as much, to SLACK of the largest coordinate. Others may be looked at, too. */
void runs_visit(const Polygon *a, const Polygon *b, double reach, Look *look, void *of);

#endif
