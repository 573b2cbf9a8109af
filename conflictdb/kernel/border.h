/* The border: what is done with all that comes in. */
#ifndef CONFLICTDB_BORDER_H
#define CONFLICTDB_BORDER_H

#include "encounter.h"

KernelStatus border_check_plane(const KernelPlane *plane);

/* That arrays are there, and that their counts and offsets fit. */
KernelStatus border_check_pieces(const KernelPieces *pieces);

/* Prepare the body of a piece in a scene; one that cannot be is not sound. */
void border_prepare(const Scene *scene, const KernelPieces *pieces, int64_t piece);

/* Check what a call on pairs is given, and take memory for the polygons of an encounter; the caller frees it. */
KernelStatus border_begin(const Scene *scene, const KernelPairs *pairs, Encounter *pair, double **memory);

/* Set an encounter up for pair i; false where it has no time that can be, or a piece that cannot. */
bool border_meet(const Scene *scene, const KernelPairs *pairs, int64_t i, Encounter *pair);

#endif
