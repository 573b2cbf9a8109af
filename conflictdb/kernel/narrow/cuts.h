/* Cuts: which parts of a box of two times are proven to be without contact (differences.c). */
#ifndef CONFLICTDB_CUTS_H
#define CONFLICTDB_CUTS_H

#include "narrow/shift.h"

/* Axes between nearest points that are kept, to cut later boxes. Fewer: more boxes. */
enum { AXES = 12 };

/* A box of both times, the part of it in which contact is possible, and a bound on what is sought there. */
typedef struct {
    double u0, u1, v0, v1, bound;
    Part part;
} Box;

/* halves: of the vertices of a0, a1, b0 and b1. touch_m: by how much a detection may understate a distance. a_step,
 * b_step: one edge in this many cuts. */
typedef struct {
    Shift shift;
    double *halves[4], touch_m;
    bool is_long;
    int64_t a_step, b_step;
    Vector axes[AXES];
    int axis_count;
} Cuts;

/* How far vertices leave their chords; the rounding error bound; how much the reach may be overstated: plane metres. */
typedef struct {
    double bend_a, bend_b, touch, unknown;
} Slack;

/* Where the largest difference is that of a vertex passing a vertex at the reach: the direction of the relative velocity;
 * both velocities along it, plane m/s; a bound on the difference, and by how much the gap shrinks with it, plane m/s. */
typedef struct {
    Vector along;
    double a, b, bound, rate;
} Passing;

/* Begin with a pair whose movers are set. */
void cuts_begin(Cuts *cuts);

/* Compute the polygons at the ends of a box, and their halves; before the cuts of this box. */
Slack cuts_put_ends(Cuts *cuts, const Box *box);

/* Cut by the normals of edges and by the axes that were kept. */
void cuts_by_all(Cuts *cuts, Box *box, Slack slack);

/* Cut along a new axis, and keep it for later boxes in place of the oldest. */
void cuts_by_axis(Cuts *cuts, Box *box, Slack slack, Vector axis);

/* Cut across the relative velocity. There the gap must change as much with one time as with the other; with a factor, by as
 * much less. The bound is infinite without a reach, if a piece stands still, and of factors. */
Passing cuts_by_passing(Cuts *cuts, Box *box, Slack slack, double sign);

/* Cut by the near part of the side that separates the tip of box->bound, if nothing but the halves of the side's ends keeps
 * it. at_tip, nearest: its clearance and places. */
void cuts_by_near_part(Cuts *cuts, Box *box, Slack slack, double sign, double at_tip, const Nearest *nearest);

#endif
