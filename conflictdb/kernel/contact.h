/* What is certain of a pair at once: the method `exact`, before any search. */
#ifndef CONFLICTDB_CONTACT_H
#define CONFLICTDB_CONTACT_H

#include "encounter.h"

typedef enum {
    IS_UNDECIDED,  /* neither of these is proven: a touch, several contacts, polygons without an inside */
    IS_SEPARATED,  /* further apart than wanted by more than the margin, throughout */
    IS_CLOSE,      /* apart, but within the margin at some instant */
    IS_IN_CONTACT  /* nearer than wanted from start to end; at any other instant not */
} Outcome;

/* Whether a pair in contact is nearer than wanted by more than the margin at some instant. */
typedef enum { IS_EITHER, IS_SHALLOW, IS_DEEP } Depth;

/* Instants in seconds from the pair's zero. The true ends lie within, by error at most at either end. */
typedef struct {
    Outcome outcome;
    Depth depth;
    double start, end, error;
} Contact;

/* What is certain of a pair whose pieces can be, during [low, high]. */
Contact certain_contact(Encounter *pair, double low, double high);

#endif
