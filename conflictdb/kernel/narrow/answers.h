/* The list of contacts that a call finds. */
#ifndef CONFLICTDB_ANSWERS_H
#define CONFLICTDB_ANSWERS_H

#include <stdbool.h>
#include <stddef.h>

#include "kernel.h"

/* A growing list of contacts. pair: the pair that contacts are added for. is_full: out of memory; the list is
 * incomplete. */
typedef struct {
    KernelContact *items;
    int64_t count, room, pair;
    bool is_full;
} Answers;

/* The callback for where a contact may be, and its arguments. ask: NULL without a callback. */
typedef struct {
    KernelGuess *ask;
    void *of;
    int64_t pair;
} Guess;

/* Add a contact of the pair (contacts.c). */
void answers_add(Answers *answers, double start, double end, double error, KernelVerdict verdict, bool touches);

#endif
