/* Polygons in motion: where the vertices of a piece are, how fast they go, and how far they may leave even motion.
 *
 * A body is a piece of the scene, prepared once; a mover is a body in a pair, with seconds counted from the pair's
 * zero and plane metres from the pair's origin, so that coordinates keep their digits. A further motion is a further
 * case here, with the functions of `mover_...` and its own file (docs/explanation/kernel.md).
 */
#ifndef CONFLICTDB_MOTION_H
#define CONFLICTDB_MOTION_H

#include <math.h>

#include "earth.h"
#include "polygon.h"

typedef enum { STANDS_STILL, ON_RHUMB_LINE, ON_GREAT_CIRCLE } Motion;

/* The power series of psi about a place of a rhumb leg, and when the leg is there, seconds of it. terms: 0 if there is no
 * such series. */
typedef struct {
    int64_t terms;
    double at_s;
    Vector place; /* plane metres */
    double series[EARTH_TERMS];
} RhumbSeries;

/* A haven on a rhumb leg (rhumb.c); latitudes are rectifying, radians. */
typedef struct {
    double start_mu, delta_mu; /* latitude of the leg's start, and its change on the leg */
    double rate_x;             /* plane metres of x per unit of progress times stretch */
    double leg_s;
    double east, north;        /* of the heading */
    Vector start;              /* of the leg, plane metres */
    double size;               /* of the haven: the furthest vertex, radians */
    int64_t order;             /* terms of the power series about the reference point; 0: the closed form */
    RhumbSeries about_slice;   /* if it serves all of the slice */
    /* The northernmost and southernmost vertex or step against the reference point, and the longest way that one goes
     * east or west, at the leg's start; and their changes per second, which bound them as they are convex in time. */
    double up, down, step, up_rate, down_rate, step_rate;
    /* Per second: the largest rate of any latitude, that of a vertex against the reference point, and the largest rate
     * at which a vertex's two steps grow to the east or west; the last two are 0 for a haven that does not change. */
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
    bool is_sound;  /* else its pairs are undecided */
    bool is_convex; /* whether the vertices are known to stay in convex position */
    bool changes;   /* whether the haven has another outline at the end of the leg */
    int64_t first, count;
    int64_t leg_start_us;
    Vector origin; /* a plane point at or near it */
    union {
        RhumbLeg rhumb;
        CircleLeg circle;
    } leg;
} Body;

/* What vertices of bodies are held in, columns of (vertex_count,) each. Still: x and y, plane metres. Rhumb lines:
 * forward and starboard at the leg's start, and their rates, radians. Great circles: the same, and p, q and s (x, y, up
 * each) of a haven that does not change: the vertex is at cos(theta) p + sin(theta) q + s. */
enum { FORWARD, STARBOARD, FORWARD_RATE, STARBOARD_RATE, RHUMB_COLUMNS, P = RHUMB_COLUMNS, Q = P + 3, S = Q + 3,
       CIRCLE_COLUMNS = S + 3 };

struct KernelScene {
    KernelPlane plane;
    int64_t count, vertex_count;
    Body *bodies;
    double *columns;
};
typedef struct KernelScene Scene;

/* A body in a pair. frame: (9, count) of a great circle's p, q, s counted from the origin. */
typedef struct {
    const Scene *scene;
    const Body *body;
    double into_s; /* seconds of the leg gone at the pair's zero */
    Vector origin;
    double *frame;
    CircleLeg leg; /* of a great circle, counted from the origin */
    RhumbSeries near; /* on a rhumb line, where it is in focus: within near_s of the middle */
    double near_s;
} Mover;

/* Bounds on a mover's vertices during a time: of the second derivative, plane m/s^2, and of how far any velocity is
 * from that of the whole polygon in the middle, plane m/s. */
typedef struct {
    double acceleration, spread;
} Bounds;

/* The second derivative of a mover's reference point in the middle of a time, and a bound on how far that of any vertex
 * is from it at any instant of the time, plane m/s^2. */
typedef struct {
    Vector middle;
    double variation;
} Acceleration;

/* Bounds on where a mover's vertices are during a time: how far any is outside of the hull of its ends, plane metres,
 * and the largest scale (plane.h) that one has. */
typedef struct {
    double deviation, scale;
} Sweep;

/* Put a body into a pair. frame: room for 9 numbers a vertex. */
Mover mover_make(const Scene *scene, const Body *body, int64_t zero_us, Vector origin, double *frame);

/* Whether it is short of the poles during a time, as it is on its leg: one that goes on beyond that may not be. */
bool mover_is_there(const Mover *mover, double t0, double t1);

/* Make ready for many instants of a time. Before and elsewhere a mover is where it is then, only with more work. */
void mover_focus(Mover *mover, double t0, double t1);

/* Put the vertices where they are at t; those of a body that is not known to be convex are in no order then. */
void mover_place(const Mover *mover, double t, Polygon *polygon);

/* One velocity for the whole polygon at t, plane m/s. */
Vector mover_velocity(const Mover *mover, double t);

Bounds mover_bounds(const Mover *mover, double t0, double t1);
Acceleration mover_acceleration(const Mover *mover, double t0, double t1);

/* Where the reference point of a haven is at t, plane metres. */
Vector mover_reference(const Mover *mover, double t);

/* change: the most that any vertex's offset from the reference point differs at t0 and t1, plane metres. What stands
 * still has none of this. */
Sweep mover_sweep(const Mover *mover, double t0, double t1, double change);

static inline const double *body_column(const Scene *scene, const Body *body, int column) {
    return scene->columns + column * scene->vertex_count + body->first;
}

/* Each motion: prepare a body (false: it cannot be), and what the functions above do. */
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

/* For corners i of an outline: the sides that meet at the next vertex, at both ends of the leg. */
typedef struct {
    Vector side, next, last_side, last_next; /* at the start, and at the end */
    bool changes;                            /* whether either differs */
} Corner;

/* Corner i of a piece's outline, over the length that `unit_m` metres are. */
Corner corner_of(const KernelPieces *pieces, const Body *body, int64_t i, double unit_m);

/* The least turn of a corner while its vertices move straight from start to end, where counter-clockwise is positive:
 * a quadratic in time, which its Bernstein coefficients bound. */
double corner_least_turn(const Corner *corner);

static inline double cross(Vector a, Vector b) { return a.x * b.y - a.y * b.x; }
static inline double norm(Vector a) { return hypot(a.x, a.y); }

#endif
