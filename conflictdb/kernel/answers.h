/* The contacts that are found, as many as there are. */
#ifndef CONFLICTDB_ANSWERS_H
#define CONFLICTDB_ANSWERS_H

#include <stdbool.h>
#include <stddef.h>

#include "kernel.h"

/* Contacts of pairs; pair: the one that they are being found of. is_full: there was no memory for one. */
typedef struct {
    KernelContact *items;
    int64_t count, room, pair;
    bool is_full;
} Answers;

/* Somebody who says where a contact may be. */
typedef struct {
    KernelGuess *ask;
    void *of;
    int64_t pair;
} Guess;

/* Add a contact of the pair (contacts.c). */
void answers_add(Answers *answers, double start, double end, double error, KernelVerdict verdict, bool touches);

#endif
