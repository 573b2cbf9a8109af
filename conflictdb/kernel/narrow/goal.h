/* Goals: what is sought over the contact set of two times (differences.c). */
#ifndef CONFLICTDB_GOAL_H
#define CONFLICTDB_GOAL_H

#include <math.h>
#include <stdbool.h>

#include "narrow/part.h"

/* The difference v - weight u, or the factor v / u by which the times of a are stretched; asked about from least to most. Of
 * factors, v is known to pad_s seconds only: the times of a stretched track are rounded. */
typedef struct {
    bool is_factor;
    double least, most, pad_s, weight;
} Goal;

/* The goal at a point, if sign is 1, or its negative, if it is -1. At u = 0 each factor is possible. The pad counts outward. */
static inline double goal_value(const Goal *goal, double sign, Times at) {
    if (!goal->is_factor) return sign * (at.v - goal->weight * at.u);
    double low = sign > 0.0 ? goal->least : -goal->most, high = sign > 0.0 ? goal->most : -goal->least;
    double value = at.u > 0.0 ? (sign * at.v + goal->pad_s) / at.u : INFINITY;
    return value < low ? low : value > high ? high : value;
}

/* The same of times that are not rounded. */
double goal_exactly(const Goal *goal, double sign, Times at);

/* Whether a point is asked about. */
bool goal_is_asked(const Goal *goal, Times at);

/* Keep what may have at least this value. */
void goal_cut(const Goal *goal, Part *part, double sign, double value);

/* Keep what is asked about. */
void goal_cut_asked(const Goal *goal, Part *part);

/* The largest value of a part, and where; -INFINITY if the part is empty. */
double goal_highest(const Goal *goal, const Part *part, double sign, Times *at);

#endif
