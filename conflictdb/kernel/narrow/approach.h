/* Closest approach: distances of a pair, and lower bounds on them during a time. */
#ifndef CONFLICTDB_APPROACH_H
#define CONFLICTDB_APPROACH_H

#include "narrow/encounter.h"

/* The distance of a pair in the middle of a time, and a lower bound on it during the time; metres on the earth. */
typedef struct {
    double middle, bound;
} During;

/* Bound the distance during [start, end], given the distances `first` and `last` at its ends. enough: the middle is not
 * computed if the cheapest bound reaches this. */
During approach_during(Encounter *pair, double start, double end, double first, double last, double enough);

/* Lower bound on the distance during [low, high], from the bounding boxes of both paths only. */
double approach_at_least(Encounter *pair, double low, double high);

/* The distance at an instant; 0 if the polygons overlap. */
double approach_distance(Encounter *pair, double t);

#endif
