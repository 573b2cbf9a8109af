/* The border: what every call on pairs of pieces begins with. */
#ifndef CONFLICTDB_BORDER_H
#define CONFLICTDB_BORDER_H

#include "contact.h"

/* Check what a call on pairs is given, and take memory for the polygons of an encounter; the caller frees it. */
KernelStatus border_begin(const Scene *scene, const KernelPairs *pairs, Encounter *pair, double **memory);

/* Set an encounter up for pair i; false where it has no instant to count from or a piece that cannot be. */
bool border_meet(const Scene *scene, const KernelPairs *pairs, int64_t i, Encounter *pair);

#endif
