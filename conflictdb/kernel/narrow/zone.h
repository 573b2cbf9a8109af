/* Proofs on the earth for the zone in which the plane's scale cannot decide whether the separation is violated. */
#ifndef CONFLICTDB_ZONE_H
#define CONFLICTDB_ZONE_H

#include "narrow/encounter.h"

/* Distant polygons may have several shortest lines: limit as a fraction of the earth's radius. */
static const double FURTHEST_SHARE = 0.5;
/* The curvature of any figure of the earth is at most that of a sphere with this fraction of the equator's radius. */
static const double LEAST_RADIUS_SHARE = 0.99;

/* Whether the distance on the earth changes in one direction only, from a limit to an end at which the pair is nearer.
 * scales: of a time around both, whose ends are a0, b0, a1 and b1. */
bool zone_closes_in(Encounter *pair, double limit, double end, Scales scales);

/* Whether the pair is farther apart than the separation throughout, given that it is at both instants. */
bool zone_is_apart(Encounter *pair, double from, double to);

/* Whether the pair is nearer than the separation throughout, given that it is at both instants; at `from` perhaps only
 * just. */
bool zone_is_near(Encounter *pair, double from, double to);

#endif
