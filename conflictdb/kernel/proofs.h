/* Proofs over intervals of time: that two polygons stay apart throughout, and that they stay in contact throughout. */
#ifndef CONFLICTDB_PROOFS_H
#define CONFLICTDB_PROOFS_H

#include "encounter.h"

/* Intervals are not split below a microsecond, the resolution of a timestamp. With more, grazing contacts stay
 * undecided. */
static const double SHORTEST_INTERVAL_S = 1e-6;

/* Leave of some intervals those in which the clearance is not proven to exceed the margin, each with its reason.
 *
 * Outside of what is left, clearance > margin_m is proven; a negative margin allows that much overlap. An interval is
 * left whole as soon as its middle is found nearer: it may hold more than is needed, never less. They are in no order. */
void undecided_separation(Encounter *pair, Intervals *intervals, double margin_m);

/* The same of one interval [start, end] alone. */
void undecided_separation_in(Encounter *pair, Intervals *intervals, double start, double end, double margin_m);

/* Leave of [start, end] the intervals in which the pair is not proven to be in contact throughout: those of reason
 * NEARBY are apart at the instant `at`; those of reason BORDERLINE may only touch, or were given up. */
void undecided_contact(Encounter *pair, Intervals *intervals, double start, double end);

#endif
