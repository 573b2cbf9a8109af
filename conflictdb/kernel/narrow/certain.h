/* What can be proven about a pair without a search (search.c). */
#ifndef CONFLICTDB_CERTAIN_H
#define CONFLICTDB_CERTAIN_H

#include "narrow/encounter.h"

typedef enum {
    IS_UNDECIDED,  /* none of these is proven: a grazing touch, several contacts, degenerate polygons */
    IS_SEPARATED,  /* farther apart than the separation plus the margin, throughout */
    IS_CLOSE,      /* apart, but within the margin at some instant */
    IS_IN_CONTACT  /* loss of separation during [start, end] only */
} Outcome;

/* Whether a pair in contact violates the separation by more than the margin at some instant. */
typedef enum { IS_EITHER, IS_SHALLOW, IS_DEEP } Depth;

/* Instants in seconds from the pair's zero. Each true end lies within, at most `error` inside. */
typedef struct {
    Outcome outcome;
    Depth depth;
    double start, end, error;
} Contact;

/* Decide a pair of valid pieces during [low, high]. */
Contact certain_contact(Encounter *pair, double low, double high);

#endif
