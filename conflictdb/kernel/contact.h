/* When two movers are nearer than a distance, proven: the method `exact`. */
#ifndef CONFLICTDB_CONTACT_H
#define CONFLICTDB_CONTACT_H

#include "motion.h"
#include "plane.h"

/* Two movers, and room for their polygons at the ends of a time and, convex, at an instant of it. */
typedef struct {
    const KernelPlane *plane;
    Mover a, b;
    double separation_m, margin_m;
    Polygon a0, b0, a1, b1, a_now, b_now, spare;
    KernelWork *work;
} Encounter;

/* Instants in seconds from the pair's zero (see kernel.h). */
typedef struct {
    KernelOutcome outcome;
    double start, end, error;
} Contact;

/* Put both polygons where they are at an instant, convex, in a_now and b_now. */
void encounter_place(Encounter *pair, double t);

/* When they are nearer than separation_m, or touch where that is 0, during [low, high]. */
Contact encounter_contact(Encounter *pair, double low, double high);

/* Whether they overlap by more than the margin during [low, high]. */
KernelOutcome encounter_depth(Encounter *pair, double low, double high);

#endif
