/* Two movers in time: where they are at an instant, how far apart, and how far they may leave even motion. */
#ifndef CONFLICTDB_ENCOUNTER_H
#define CONFLICTDB_ENCOUNTER_H

#include "motion.h"
#include "plane.h"

/* A time of a pair, seconds from its zero. at: an instant in it that shows why it is left undecided. */
typedef enum {
    IN_CONTACT, /* in contact then */
    NEARBY,     /* apart then, but within the margin */
    BORDERLINE  /* neither is shown, down to the shortest interval, or the work was used up */
} Reason;
typedef struct {
    double start, end, at;
    Reason reason;
} Interval;

/* Intervals; there is room for `most`. */
typedef struct {
    Interval *items;
    int64_t count, most;
} Intervals;

/* Two movers, and room for their polygons at the ends of a time and, convex, at an instant of it.
 *
 * margin_m: closeness that is too close to call, at least KERNEL_TOUCH_M. deep_m: by how much a pair must be nearer
 * than wanted to be so beyond the margin and beyond doubt. undecided, deeper, spare_time: room for the search. looks_left:
 * intervals that the search may still look at before it halves none any more. parts_left: as for plane_distance_m; below 0
 * nothing that was found of the pair counts. in_closed_form: whether the closed form decides the pair; closed_form_since_s:
 * since when it has been at work, 0 where it is not. */
typedef struct {
    const KernelPlane *plane;
    Mover a, b;
    double separation_m, margin_m, deep_m;
    Polygon a0, b0, a1, b1, a_now, b_now, spare;
    Intervals undecided, deeper, spare_time;
    int64_t looks_left, parts_left;
    bool in_closed_form;
    double closed_form_since_s;
    KernelWork *work;
} Encounter;

/* Seconds of a clock that only goes forward. */
double encounter_clock_s(void);

/* Say whether the closed form is at work on the pair. The clock is read where that changes: not for every pair. */
void encounter_set_closed_form(Encounter *pair, bool in_closed_form);

/* Set what is asked of pairs: the separation wanted, and the margin. */
void encounter_ask(Encounter *pair, double separation_m, double margin_m);

/* Put both polygons where they are at an instant: vertices in no order, perhaps; and convex ones, into a_now, b_now. */
void encounter_put(Encounter *pair, double t, Polygon *a, Polygon *b);
void encounter_place(Encounter *pair, double t);

/* The sum of what bounds either. */
Bounds encounter_bounds(const Encounter *pair, double t0, double t1);

/* The same of one against the other: sharper where both curve alike, as ships in line do. It takes longer. */
Bounds encounter_relative_bounds(const Encounter *pair, double t0, double t1);

/* The extent of the polygons at both ends of a time, which are put there. */
Extent encounter_extent(Encounter *pair, double start, double end);

/* The scales of places that are within reach of each other, plane metres, while the pair moves from where a0 and b0 are to
 * where a1 and b1 are. */
Scales encounter_scales_within(const Encounter *pair, double reach);

/* The gap between touching polygons at an instant, and its axis; the same where the distance counts, too. */
Gap encounter_gap(Encounter *pair, double t);
Gap encounter_plane_distance(Encounter *pair, double t);

/* How much further apart than wanted the pair is, metres on the earth; negative is a loss of separation. Where it is
 * more than within_m, any number above that. */
double encounter_clearance_m(Encounter *pair, double t, double within_m);

/* By how much a distance that is found may be less than the true one; 0 where it comes from the plane. */
double encounter_distance_error_m(const Encounter *pair, double distance_m);

/* How much nearer than wanted a pair must be found to be so beyond doubt, metres on the earth. */
double encounter_certainty_margin_m(const Encounter *pair);

#endif
