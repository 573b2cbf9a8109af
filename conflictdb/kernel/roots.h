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

/* Where a measure falls from `gap` > touch at `outside` to `depth` < -touch at `inside`: first to zero, and from there
 * to where it is beyond doubt on either side, by one to three times `touch`. */
Root root_between(Measure *measure, void *of, double outside, double gap, double inside, double depth, double touch);

#endif
