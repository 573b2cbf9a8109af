/* The boundary of the library: validation of input, preparation of pieces, set-up of encounters. */
#ifndef CONFLICTDB_BORDER_H
#define CONFLICTDB_BORDER_H

#include "narrow/encounter.h"

KernelStatus border_check_plane(const KernelPlane *plane);

/* Check that required arrays are given, and that their counts and offsets fit. */
KernelStatus border_check_pieces(const KernelPieces *pieces);

/* Prepare the body of a piece in a scene; is_sound of an invalid piece stays false. */
void border_prepare(const Scene *scene, const KernelPieces *pieces, int64_t piece);

/* Validate the pairs and distances of a call, and allocate the polygons of an encounter; the caller frees `memory`. */
KernelStatus border_begin(const Scene *scene, const KernelPairs *pairs, Encounter *pair, double **memory);

/* The same, for polygons of several times as many vertices. */
KernelStatus border_begin_larger(const Scene *scene, const KernelPairs *pairs, int64_t times, Encounter *pair, double **memory);

/* Set up an encounter for pair i; false if its time or one of its pieces is invalid. */
bool border_meet(const Scene *scene, const KernelPairs *pairs, int64_t i, Encounter *pair);

/* Set up a mover of a piece whose seconds count from zero_us, during [low, high]; false if its time or the piece is
 * invalid. The frame of the mover is kept. */
bool border_move(const Scene *scene, int64_t piece, int64_t zero_us, double low, double high, Vector origin, Mover *mover);

#endif
