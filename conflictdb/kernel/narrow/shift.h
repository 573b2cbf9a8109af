/* A shift: two movers, each at a time of its own, and how near they come to each other. */
#ifndef CONFLICTDB_SHIFT_H
#define CONFLICTDB_SHIFT_H

#include "narrow/encounter.h"
#include "narrow/goal.h"

/* reach_m: within this, metres on the earth, the movers are in contact; 0: if they touch. u0 to v1: the times of the movers.
 * evaluations_left: budget of positions; when it is exhausted, no further way is
 * proven to be in contact; proofs of separation go on. */
typedef struct {
    Encounter *pair;
    double reach_m;
    double u0, u1, v0, v1;
    Goal goal;
    int64_t evaluations_left;
} Shift;

/* The plane gap of two movers; a unit vector along which they are apart if they are; and their nearest places. */
typedef struct {
    double gap;
    Vector axis, from, to;
} Nearest;

/* Clearance at two times; negative is contact. Apart with a reach: an upper bound on the distance minus the reach, metres on
 * the earth. Else in plane metres, and only its sign counts. nearest: or NULL. */
double shift_clearance_m(Shift *shift, Times at, Nearest *nearest);

/* Whether each value of the goal between those of two contacts is one of contact, on a way between them. If that is not
 * proven, both are moved to contacts between which it is; false if there are none. middle: a point by which the way may
 * lead. */
bool shift_contact_lasts(Shift *shift, Times *from, Times *to, Times middle);

#endif
