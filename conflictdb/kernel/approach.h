/* How close two objects come, when and where: the closest approach of groups of pairs. */
#ifndef CONFLICTDB_APPROACH_H
#define CONFLICTDB_APPROACH_H

#include "encounter.h"

/* How far apart a pair is in the middle of a time, and what it is nowhere below during it; metres on the earth. */
typedef struct {
    double middle, bound;
} During;

/* Bound the distance during [start, end], at whose ends it is `first` and `last`. enough: a bound as good need not be
 * better. */
During approach_during(Encounter *pair, double start, double end, double first, double last, double enough);

/* What the distance is nowhere below during [low, high], from the boxes about both ways alone. */
double approach_at_least(Encounter *pair, double low, double high);

/* The distance at an instant; 0 where they overlap. */
double approach_distance(Encounter *pair, double t);

#endif
