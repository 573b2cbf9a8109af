/* Regions as rings: their union in the plane, and their outlines in longitude and latitude. */
#ifndef CONFLICTDB_RINGS_H
#define CONFLICTDB_RINGS_H

#include "planes/plane.h"

/* Open rings of one region. Ring i has the vertices [offset[i], offset[i + 1]); a hole belongs to the last shell before it.
 * The inside is on the left of every side, so that holes are clockwise. */
typedef struct {
    double (*vertex)[2];
    int64_t *offset;
    int8_t *is_hole;
    int64_t count, vertices, ring_room, vertex_room;
} Rings;

/* Make room for more rings and vertices; false without memory. */
bool rings_make_room(Rings *rings, int64_t more_rings, int64_t more_vertices);

void rings_clear(Rings *rings);

/* End the ring whose vertices were appended since the last one ended; there is room for it. */
static inline void rings_end(Rings *rings, bool is_hole) {
    REQUIRE(rings->count < rings->ring_room && rings->vertices <= rings->vertex_room);
    rings->is_hole[rings->count++] = is_hole;
    rings->offset[rings->count] = rings->vertices;
}

static inline void rings_add(Rings *rings, double x, double y) {
    REQUIRE(rings->vertices < rings->vertex_room);
    rings->vertex[rings->vertices][0] = x, rings->vertex[rings->vertices++][1] = y;
}

void rings_free(Rings *rings);

/* Twice the signed area of a ring: positive counter-clockwise. */
double ring_doubled_area(const double (*vertex)[2], int64_t count);

/* Whether a place is inside rings, by parity: 1 or 0; -1 if rounding decides. */
int rings_hold(const Rings *rings, const double *place);

/* Twice the area of the triangle to a point from a side, if its sign is certain; else 0. */
double turn_of(const double *from, const double *to, const double *at);

/* The shortest step that leaves two lines through a corner by `first` and `last`. one, other: their unit normals. */
static inline Vector step_for(Vector one, double first, Vector other, double last) {
    double turn = one.x * other.x + one.y * other.y;
    if (first * turn >= last) return (Vector){first * one.x, first * one.y};
    if (last * turn >= first) return (Vector){last * other.x, last * other.y};
    double rest = 1.0 - turn * turn, a = (first - last * turn) / rest, b = (last - first * turn) / rest;
    return (Vector){a * one.x + b * other.x, a * one.y + b * other.y};
}

/* Memory of unions. */
typedef struct Uniting Uniting;
Uniting *uniting_make(void);
void uniting_free(Uniting *uniting);

/* Unite convex rings, closed and counter-clockwise, each grown by up to a few millimetres of the plane. False if rounding
 * decides how their sides cross; *has_memory then tells whether there was memory. */
bool unite(Uniting *uniting, const double *ring, const int64_t *ring_offset, int64_t count, Rings *found, bool *has_memory);

/* Memory of tracing, and what depends on the plane. */
typedef struct Tracing Tracing;
Tracing *tracing_make(const KernelPlane *plane, double limit_m);
void tracing_free(Tracing *tracing);

/* Append the outline of a ring of the plane, degrees; false if it is unknown: it reaches a pole, or is no wider than
 * rounding; *has_memory then tells whether there was memory. vertex: (count) open */
bool trace(Tracing *tracing, const double (*vertex)[2], int64_t count, bool is_hole, Rings *found, bool *has_memory);

#endif
