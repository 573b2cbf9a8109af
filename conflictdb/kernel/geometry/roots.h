/* Roots of a function of time between two instants, bracketed as closely as rounding allows. */
#ifndef CONFLICTDB_ROOTS_H
#define CONFLICTDB_ROOTS_H

#include <stdbool.h>

/* A function of time, such as the clearance of a pair. */
typedef double Measure(void *of, double t);

/* Instants certainly on either side of a root; is_found: they were found. */
typedef struct {
    double outer, inner;
    bool is_found;
} Root;

/* Bracket the root of a function that falls from `gap` > touch at `outside` to `depth` < -touch at `inside`. At the
 * resulting instants its magnitude is one to three times `touch`, the rounding error bound, or they are as close as
 * float64 can tell. pace: seconds per metre at `outside`, or NaN; a guess that changes the work only. */
Root root_between(Measure *measure, void *of, double outside, double gap, double inside, double depth, double touch,
                  double pace);

/* Instants at which a function is above a level (outer) and at most it (inner), close to each other. */
typedef struct {
    double outer, inner;
} Crossing;

/* Bracket where a function falls from above a level at `outside` to at most it at `inside`: within BRACKET_S of
 * roots.c, or as close as float64 can tell. If it is not above the level at `outside`, both are `outside`. */
Crossing crossing_between(Measure *measure, void *of, double level, double outside, double inside);

#endif
