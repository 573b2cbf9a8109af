/* Where a measure changes its sign between two instants, as near to each other as rounding lets them be. */
#ifndef CONFLICTDB_ROOTS_H
#define CONFLICTDB_ROOTS_H

#include <stdbool.h>

/* What is measured at an instant: how much further apart than wanted a pair is. */
typedef double Measure(void *of, double t);

/* Instants beyond doubt on either side of a change of sign, and whether they were found. */
typedef struct {
    double outer, inner;
    bool is_found;
} Root;

/* Where a measure falls from `gap` > touch at `outside` to `depth` < -touch at `inside`: to where it is beyond doubt on
 * either side, by one to three times `touch`, or as near to that as instants can be told apart. pace: how much later a
 * metre more is measured at `outside`, as far as is known, else NaN; it decides the work alone. */
Root root_between(Measure *measure, void *of, double outside, double gap, double inside, double depth, double touch,
                  double pace);

/* Instants at which a measure is above a level, and at most it, as near to each other as is useful. */
typedef struct {
    double outer, inner;
} Crossing;

/* Where a measure falls from above a level at `outside` to at most it at `inside`: no wider than BRACKET_S of roots.c,
 * or than instants can be told apart. Where it is not above the level at `outside`, that is both. */
Crossing crossing_between(Measure *measure, void *of, double level, double outside, double inside);

#endif
