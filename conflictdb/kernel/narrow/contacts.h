/* The search for the contacts of pairs: its memory, and what it finds. */
#ifndef CONFLICTDB_CONTACTS_H
#define CONFLICTDB_CONTACTS_H

#include "narrow/answers.h"
#include "narrow/encounter.h"

typedef struct {
    Encounter pair;
    Answers answers;
    double *memory;
    Interval *intervals;
} Contacts;

/* Validate the pieces of pairs and the distances, and allocate for polygons of `times` as many vertices; end with
 * contacts_end. */
KernelStatus contacts_begin(const KernelScene *scene, const KernelPairs *pairs, int64_t times, double separation_m,
                            double tolerance_m, KernelWork *work, Contacts *made);
void contacts_end(Contacts *made);

/* Add the contacts during [low, high] of the pair that is set up, or the whole time if it is not valid. Others as
 * find_contacts; pairs_of_objects as KernelQuestion. */
void contacts_find(Contacts *made, bool is_valid, double low, double high, double beyond, int64_t pairs_of_objects,
                   const Guess *guess);

#endif
