/* All contacts of any pair. */
#ifndef CONFLICTDB_SEARCH_H
#define CONFLICTDB_SEARCH_H

#include "narrow/answers.h"
#include "narrow/encounter.h"

/* Add the contacts of a pair of valid pieces during [low, high], in order of time. beyond: first instant after the
 * span, which excludes it; infinite: the span includes its last instant */
void find_contacts(Encounter *pair, double low, double high, double beyond, const Guess *guess, Answers *answers);

#endif
