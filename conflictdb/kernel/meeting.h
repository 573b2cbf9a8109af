/* How two movers lie to each other at an instant. */
#ifndef CONFLICTDB_MEETING_H
#define CONFLICTDB_MEETING_H

#include "contact.h"

/* Where they meet: a point of both where they overlap, else halfway between their nearest points in the plane; plane
 * metres from the plane's own origin. */
Vector encounter_meeting(Encounter *pair, double t);

#endif
