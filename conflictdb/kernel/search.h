/* All contacts of any pair, with their verdicts. */
#ifndef CONFLICTDB_SEARCH_H
#define CONFLICTDB_SEARCH_H

#include "answers.h"
#include "encounter.h"

/* Add the contacts of a pair whose pieces can be, during [low, high], in the order of time.
 *
 * beyond: the first instant that is no longer in the span; infinite where the last one is */
void find_contacts(Encounter *pair, double low, double high, double beyond, const Guess *guess, Answers *answers);

#endif
