/* The call that finds contacts: the memory that a search needs, and what it finds. */
#include <stdlib.h>

#include "answers.h"
#include "border.h"
#include "search.h"

/* Intervals that are looked at for two objects, shared by their pairs of pieces, and for one pair of pieces at least and
 * at most, in each step of its search; in all steps its share, but at least as many as one of them may take. Beyond it a
 * pair is left undecided rather than let one take all time. */
enum { MAX_INTERVALS = 131072, MIN_INTERVALS_PER_PAIR = 256, MAX_INTERVALS_PER_PAIR = 8192 };
/* Halvings of sides for the distances of a pair at least, whatever its share of PLANE_MAX_PARTS: twice what was seen within
 * five degrees of a pole. With fewer, pairs that are wanted far apart there are unresolved. */
enum { MIN_PARTS_PER_PAIR = 65536 };

/* Give the search room in memory. */
static void lay_out_intervals(Encounter *pair, Interval *memory) {
    pair->undecided.items = memory;
    pair->deeper.items = memory + MAX_INTERVALS_PER_PAIR;
    pair->spare_time.items = memory + 2 * MAX_INTERVALS_PER_PAIR;
}

/* Let a pair have its share of the work that may be done for two objects. */
static void share_work(Encounter *pair, int64_t company) {
    int64_t share = MAX_INTERVALS / (company > 1 ? company : 1), most = share;
    most = most < MIN_INTERVALS_PER_PAIR ? MIN_INTERVALS_PER_PAIR : most > MAX_INTERVALS_PER_PAIR ? MAX_INTERVALS_PER_PAIR : most;
    pair->undecided.most = pair->deeper.most = pair->spare_time.most = most;
    pair->looks_left = share < MAX_INTERVALS_PER_PAIR ? MAX_INTERVALS_PER_PAIR : share;
    int64_t parts = PLANE_MAX_PARTS / (company > 1 ? company : 1);
    pair->parts_left = parts < MIN_PARTS_PER_PAIR ? MIN_PARTS_PER_PAIR : parts;
}

void answers_add(Answers *answers, double start, double end, double error, KernelVerdict verdict, bool touches) {
    if (answers->count == answers->room) {
        int64_t room = answers->room > 0 ? 2 * answers->room : 64;
        KernelContact *items = realloc(answers->items, (size_t)room * sizeof *items);
        if (!items) {
            answers->is_full = true;
            return;
        }
        answers->items = items, answers->room = room;
    }
    answers->items[answers->count++] = (KernelContact){answers->pair, start, end, error, verdict, touches};
}

KernelStatus kernel_contacts(const KernelScene *scene, const KernelPairs *pairs, const KernelQuestion *question,
                             KernelContact **contacts, int64_t *count, KernelWork *work) {
    if (!question || !contacts || !count || !work) return KERNEL_NULL;
    double *memory;
    Encounter pair = {.separation_m = question->separation_m, .margin_m = question->tolerance_m, .work = work};
    *contacts = NULL, *count = 0, *work = (KernelWork){0};
    KernelStatus status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    Interval *intervals = malloc(3 * MAX_INTERVALS_PER_PAIR * sizeof *intervals);
    Answers answers = {.is_full = !intervals};
    encounter_ask(&pair, question->separation_m, question->tolerance_m);
    if (intervals) lay_out_intervals(&pair, intervals);
    double began_s = encounter_clock_s();
    for (int64_t i = 0; i < pairs->count && !answers.is_full; i++) {
        double low = pairs->low_s[i], high = pairs->high_s[i], beyond = question->beyond_s ? question->beyond_s[i] : INFINITY;
        Guess guess = {question->guess, question->guess_of, i};
        int64_t before = answers.count;
        answers.pair = i;
        share_work(&pair, question->company ? question->company[i] : 1);
        bool is_told = low <= high && border_meet(scene, pairs, i, &pair);
        if (is_told) find_contacts(&pair, low, high, beyond, &guess, &answers);
        if (is_told && pair.parts_left >= 0) continue;
        /* What was found without knowing all distances does not count. */
        answers.count = before;
        answers_add(&answers, low, high, high - low, KERNEL_UNRESOLVED, true);
    }
    encounter_set_closed_form(&pair, false);
    work->contacts_s = encounter_clock_s() - began_s;
    free(memory);
    free(intervals);
    if (answers.is_full) {
        free(answers.items);
        return KERNEL_NO_MEMORY;
    }
    *contacts = answers.items, *count = answers.count;
    return KERNEL_OK;
}

void kernel_contacts_free(KernelContact *contacts) { free(contacts); }
