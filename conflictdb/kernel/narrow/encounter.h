/* An encounter: two movers, their positions at an instant, their clearance, and bounds on their relative motion. */
#ifndef CONFLICTDB_ENCOUNTER_H
#define CONFLICTDB_ENCOUNTER_H

#include "planes/motion.h"
#include "planes/plane.h"

/* An undecided time of a pair, seconds from its zero. at: an instant in it that shows the reason. */
typedef enum {
    IN_CONTACT, /* in contact at `at` */
    NEARBY,     /* apart at `at`, but within the margin */
    BORDERLINE  /* neither is shown, down to the shortest interval or the end of the work budget */
} Reason;
typedef struct {
    double start, end, at;
    Reason reason;
} Interval;

/* A list of intervals of capacity `most`. */
typedef struct {
    Interval *items;
    int64_t count, most;
} Intervals;

/* Two movers, and room for their polygons at both ends of a time and at an instant of it (convex).
 *
 * margin_m: clearances within this of zero are too close to call, at least KERNEL_TOUCH_M.
 * deep_m: contact deeper than this violates the separation by more than the margin and the distance error.
 * undecided, deeper, spare_time: lists of the search.
 * looks_left: intervals that the search may still split; inspections also count, so it may become negative.
 * parts_left: budget of plane_distance_m; below 0 all results of the pair are invalid.
 * in_closed_form: the closed form decides the pair. closed_form_since_s: when that began, 0 if it does not.
 */
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

/* Seconds of a monotonic clock. */
double encounter_clock_s(void);

/* Note whether the closed form decides the pair. Reads the clock only where that changes. */
void encounter_set_closed_form(Encounter *pair, bool in_closed_form);

/* Set the required separation and the margin. */
void encounter_ask(Encounter *pair, double separation_m, double margin_m);

/* Compute both polygons at an instant: encounter_put as they are, possibly not convex; encounter_place convex, into
 * a_now and b_now. */
void encounter_put(Encounter *pair, double t, Polygon *a, Polygon *b);
void encounter_place(Encounter *pair, double t);

/* Sums of the bounds of both movers. */
Bounds encounter_bounds(const Encounter *pair, double t0, double t1);

/* Bounds on the relative motion: sharper if both paths curve alike, as for ships in line; slower to compute. */
Bounds encounter_relative_bounds(const Encounter *pair, double t0, double t1);

/* Extent of the polygons at both ends of a time; sets a0, b0, a1 and b1. */
Extent encounter_extent(Encounter *pair, double start, double end);

/* Scales at places within `reach` plane metres of the other polygon, while the pair moves from a0, b0 to a1, b1. */
Scales encounter_scales_within(const Encounter *pair, double reach);

/* At an instant: the signed separation in the plane; and the plane distance with its axis, including corners. */
Gap encounter_gap(Encounter *pair, double t);
Gap encounter_plane_distance(Encounter *pair, double t);

/* Clearance at an instant: distance minus the required separation, metres on the earth; negative is a loss of
 * separation. Above within_m: any number above within_m. */
double encounter_clearance_m(Encounter *pair, double t, double within_m);

/* How much a distance of this size may be understated; 0 for short distances, which come from the plane. */
double encounter_distance_error_m(const Encounter *pair, double distance_m);

/* Clearances below minus this are certainly negative, metres on the earth. */
double encounter_certainty_margin_m(const Encounter *pair);

#endif
