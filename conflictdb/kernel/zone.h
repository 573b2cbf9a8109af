/* Where a distance is about what is wanted, and the plane's scale does not tell whether it is: proofs on the earth. */
#ifndef CONFLICTDB_ZONE_H
#define CONFLICTDB_ZONE_H

#include "encounter.h"

/* Whether the distance on the earth changes one way only between a limit and an end at which the pair is nearer; scales:
 * of a time about them, at whose ends a0, b0, a1 and b1 are. */
bool zone_closes_in(Encounter *pair, double limit, double end, Scales scales);

/* Whether the pair is further apart than wanted all the way between two instants, at both of which it is. */
bool zone_is_apart(Encounter *pair, double from, double to);

/* Whether the pair is nearer than wanted all the way between two instants, at both of which it is, at `from` by hardly
 * more than can be told. */
bool zone_is_near(Encounter *pair, double from, double to);

#endif
