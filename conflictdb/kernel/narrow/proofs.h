/* Proofs over intervals of time: that two polygons stay apart throughout, or stay in contact throughout. */
#ifndef CONFLICTDB_PROOFS_H
#define CONFLICTDB_PROOFS_H

#include "narrow/encounter.h"

/* Intervals are not split below a microsecond, the resolution of a timestamp. Larger: grazing contacts stay undecided.
 */
static const double SHORTEST_INTERVAL_S = 1e-6;

/* Reduce intervals to those in which clearance > margin_m is not proven, each with its reason.
 *
 * Outside the remaining intervals clearance > margin_m is proven; a negative margin allows that much overlap. An
 * interval whose middle is closer is kept whole: the result may be too large, never too small. Results are in no order.
 */
void undecided_separation(Encounter *pair, Intervals *intervals, double margin_m);

/* The same for one interval [start, end]. */
void undecided_separation_in(Encounter *pair, Intervals *intervals, double start, double end, double margin_m);

/* Reduce [start, end] to the intervals in which contact throughout is not proven. Reason NEARBY: apart at the instant
 * `at`; BORDERLINE: may only touch, or the work budget is exhausted. */
void undecided_contact(Encounter *pair, Intervals *intervals, double start, double end);

#endif
