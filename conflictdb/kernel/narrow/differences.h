/* Differences of departure, or factors of time, of one pair after the other. */
#ifndef CONFLICTDB_DIFFERENCES_H
#define CONFLICTDB_DIFFERENCES_H

#include <stdbool.h>

#include "kernel.h"

/* How often the times of a pair are halved at most; and the parts that it has then. */
enum { DIFFERENCES_HALVINGS = 6, DIFFERENCES_PARTS = 1 << DIFFERENCES_HALVINGS };

/* One pair of KernelShifts. */
typedef struct {
    int64_t a, b, a_zero_us, b_zero_us;
    double a_start_s, a_end_s, b_start_s, b_end_s, least, most, weight;
    bool is_factor;
} Shifted;

/* A pair with a part of its times, and what brings it into contact. */
typedef struct {
    Shifted of;
    KernelDifference found;
} ShiftedPart;

/* Memory and work counters of a call. */
typedef struct Differences Differences;

/* Validate the pieces of pairs and the reach, and allocate; end with differences_end. work: increased */
KernelStatus differences_begin(const KernelScene *scene, const KernelPairs *pairs, double reach_m, KernelWork *work,
                               Differences **made);

/* The same for all pairs of a call. work: set to 0 */
KernelStatus differences_begin_shifts(const KernelScene *scene, const KernelShifts *shifts, double reach_m, KernelWork *work,
                                      Differences **made);
void differences_end(Differences *made);

/* Pair i of a call. */
Shifted differences_asked(const KernelShifts *shifts, int64_t i);

/* What brings a pair into contact. */
KernelDifference differences_met(Differences *made, const Shifted *one);

/* The same, in parts: times of which a part is neither proven free nor forbidden are halved. Returns the number of parts,
 * at most DIFFERENCES_PARTS, with a difference. */
int differences_in_parts(Differences *made, const Shifted *one, ShiftedPart *parts);

#endif
