/* Meeting point of two movers. */
#ifndef CONFLICTDB_MEETING_H
#define CONFLICTDB_MEETING_H

#include "narrow/certain.h"

/* The meeting point: a common point if they overlap, else halfway between their nearest points in the plane; plane
 * metres from the plane's own origin. */
Vector encounter_meeting(Encounter *pair, double t);

#endif
