/* Motion of pieces: the vertices at an instant, one velocity per polygon, and bounds on the deviation from uniform
 * motion.
 *
 * A body is a piece of the scene, prepared once. A mover is a body in a pair: seconds count from the pair's zero and
 * plane metres from the pair's origin, so that coordinates keep their digits. The reference point runs straight in the plane.
 * To add a motion, add a case here, the functions of `mover_...`, a file, and what the projection decides: its pieces
 * (scene/border.c), scale, distances and curvature (planes/plane.c; docs/explanation/kernel.md).
 */
#ifndef CONFLICTDB_MOTION_H
#define CONFLICTDB_MOTION_H

#include <math.h>

#include "planes/earth.h"
#include "geometry/polygon.h"

typedef enum { STANDS_STILL, ON_RHUMB_LINE, ON_GREAT_CIRCLE } Motion;

/* Power series of psi about a place of a rhumb leg. at_s: seconds of the leg at which the haven is there. terms: 0
 * without a series. */
typedef struct {
    int64_t terms;
    double at_s;
    Vector place; /* plane metres */
    double series[EARTH_TERMS];
} RhumbSeries;

/* A haven on a rhumb leg (rhumb.c); latitudes are rectifying, radians. */
typedef struct {
    double start_mu, delta_mu; /* latitude of the leg's start, and its change along the leg */
    double rate_x;             /* plane metres of x per unit of progress times stretch */
    double leg_s;
    double east, north;        /* components of the heading */
    Vector start;              /* start of the leg, plane metres */
    double size;               /* largest distance of a vertex from the reference point, radians */
    int64_t order;             /* terms of the power series about the reference point; 0: use the closed form */
    RhumbSeries about_slice;   /* terms > 0: valid during the whole slice */
    /* At the leg's start, relative to the reference point: the northernmost and southernmost latitude of any vertex or
     * step, and the longest step east or west. And their rates per second; they are convex in time, so these bound
     * them. */
    double up, down, step, up_rate, down_rate, step_rate;
    /* Per second: the largest rate of any latitude; the largest rate of a vertex's latitude relative to the reference
     * point; and the largest rate at which its two steps east or west grow. The last two are 0 for constant shape. */
    double fastest, climb, widen;
} RhumbLeg;

typedef struct {
    double x, y, up;
} Vector3;

/* A haven on a leg of a great circle (circle.c), in the frame (east, north, up) of the centre. */
typedef struct {
    Vector3 start, heading, starboard; /* unit vectors */
    double rate;                       /* radians per second */
} CircleLeg;

typedef struct {
    Motion motion;
    bool is_sound;  /* false: invalid piece, its pairs are undecided */
    bool is_convex; /* whether the vertices are proven to stay in convex position */
    bool changes;   /* whether the haven's shape at the end of the leg differs */
    int64_t first, count;
    int64_t leg_start_us;
    Vector origin; /* a plane point at or near the piece */
    union {
        RhumbLeg rhumb;
        CircleLeg circle;
    } leg;
} Body;

/* Columns of vertex data, (vertex_count,) each. Standing still: x and y, plane metres. Rhumb lines: forward and
 * starboard at the leg's start, and their rates, radians. Great circles: the same, and for constant shape p, q and s
 * (x, y, up each): the vertex is at cos(theta) p + sin(theta) q + s. */
enum {
    FORWARD,
    STARBOARD,
    FORWARD_RATE,
    STARBOARD_RATE,
    RHUMB_COLUMNS,
    P = RHUMB_COLUMNS,
    Q = P + 3,
    S = Q + 3,
    CIRCLE_COLUMNS = S + 3
};

struct KernelScene {
    KernelPlane plane;
    int64_t count, vertex_count;
    Body *bodies;
    double *columns;
};
typedef struct KernelScene Scene;

/* Doubles per vertex of a mover's frame. */
enum { FRAME = 9 };

/* A body in a pair. frame: (FRAME, count) p, q, s of a great circle, relative to the origin. */
typedef struct {
    const Scene *scene;
    const Body *body;
    double into_s; /* seconds of the leg elapsed at the pair's zero */
    Vector origin;
    double *frame;
    CircleLeg leg; /* great circles: relative to the origin */
    RhumbSeries near; /* rhumb lines: the series set by mover_focus, valid within near_s of its middle */
    double near_s;
} Mover;

/* Bounds on a mover's vertices during a time: the second derivative, plane m/s^2; and the spread, the largest
 * difference between any velocity and that of the whole polygon in the middle, plane m/s. */
typedef struct {
    double acceleration, spread;
} Bounds;

/* The second derivative of the reference point in the middle of a time; and a bound on its difference from that of any
 * vertex at any instant, plane m/s^2. */
typedef struct {
    Vector middle;
    double variation;
} Acceleration;

/* Bounds on a mover's vertices during a time: their distance from the convex hull of both end positions, plane metres;
 * and their largest scale (plane.h). */
typedef struct {
    double deviation, scale;
} Sweep;

/* Make a mover. frame: room for FRAME doubles per vertex. */
Mover mover_make(const Scene *scene, const Body *body, int64_t zero_us, Vector origin, double *frame);

/* Whether the haven stays short of the poles during a time. On its leg it does; beyond the leg's end it may not. */
bool mover_is_there(const Mover *mover, double t0, double t1);

/* Prepare for many instants of a time. Positions are the same without it, and outside the time, at more cost. */
void mover_focus(Mover *mover, double t0, double t1);

/* Compute the vertices at t. They may be in no order if the body is not proven convex. */
void mover_place(const Mover *mover, double t, Polygon *polygon);

/* One velocity for the whole polygon at t, plane m/s. */
Vector mover_velocity(const Mover *mover, double t);

Bounds mover_bounds(const Mover *mover, double t0, double t1);
Acceleration mover_acceleration(const Mover *mover, double t0, double t1);

/* The reference point of a haven at t, plane metres. */
Vector mover_reference(const Mover *mover, double t);

/* change: the largest change, between t0 and t1, of a vertex's offset from the reference point, plane metres; 0 for
 * pieces that stand still. */
Sweep mover_sweep(const Mover *mover, double t0, double t1, double change);

static inline const double *body_column(const Scene *scene, const Body *body, int column) {
    REQUIRE(column >= 0 && column < (scene->plane.projection == KERNEL_MERCATOR ? RHUMB_COLUMNS : CIRCLE_COLUMNS));
    return scene->columns + column * scene->vertex_count + body->first;
}

/* The functions of each motion. ..._prepare returns false for an invalid piece; the others implement mover_.... */
bool rhumb_prepare(const Scene *scene, const KernelPieces *pieces, int64_t piece, Body *body);
bool rhumb_is_there(const Mover *mover, double t0, double t1);
void rhumb_focus(Mover *mover, double t0, double t1);
void rhumb_place(const Mover *mover, double t, Polygon *polygon);
Vector rhumb_velocity(const Mover *mover, double t);
Bounds rhumb_bounds(const Mover *mover, double t0, double t1);
Acceleration rhumb_acceleration(const Mover *mover, double t0, double t1);
Vector rhumb_reference(const Mover *mover, double t);
Sweep rhumb_sweep(const Mover *mover, double t0, double t1, double change);

bool circle_prepare(const Scene *scene, const KernelPieces *pieces, int64_t piece, Body *body);
void circle_count_from(Mover *mover);
void circle_place(const Mover *mover, double t, Polygon *polygon);
Vector circle_velocity(const Mover *mover, double t);
Bounds circle_bounds(const Mover *mover, double t0, double t1);
Acceleration circle_acceleration(const Mover *mover, double t0, double t1);
Vector circle_reference(const Mover *mover, double t);
Sweep circle_sweep(const Mover *mover, double t0, double t1, double change);

/* Corner of an outline: the two sides that meet at a vertex, at both ends of the leg. */
typedef struct {
    Vector side, next, last_side, last_next; /* at the start, and at the end */
    bool changes;                            /* whether either side changes */
} Corner;

/* The corner after side i of a piece's outline; sides are divided by unit_m. */
Corner corner_of(const KernelPieces *pieces, const Body *body, int64_t i, double unit_m);

/* Smallest turn of a corner while its vertices move straight from start to end; counter-clockwise is positive. It is
 * quadratic in time, bounded by its Bernstein coefficients. */
double corner_least_turn(const Corner *corner);

static inline double cross(Vector a, Vector b) { return a.x * b.y - a.y * b.x; }
static inline double norm(Vector a) { return hypot(a.x, a.y); }

#endif
