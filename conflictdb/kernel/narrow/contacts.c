/* kernel_contacts: allocate the memory of the search, divide work budgets, and collect the contacts. */
#include <stdlib.h>

#include "narrow/answers.h"
#include "narrow/contacts.h"
#include "scene/border.h"
#include "narrow/search.h"

/* Work budget of the search. Two objects may inspect MAX_INTERVALS intervals, divided among their pairs of pieces. One
 * step of a pair's search may inspect its share, within [MIN, MAX]_INTERVALS_PER_PAIR; all its steps together its
 * share, but at least MAX_INTERVALS_PER_PAIR and those of two steps. A pair that exhausts its budget is left undecided. */
enum { MAX_INTERVALS = 131072, MIN_INTERVALS_PER_PAIR = 256, MAX_INTERVALS_PER_PAIR = 8192 };
/* Smallest budget of a pair for bisections of sides in distances, whatever its share of PLANE_MAX_PARTS: twice the most
 * seen within five degrees of a pole. Smaller: pairs with a large separation near poles are unresolved. */
enum { MIN_PARTS_PER_PAIR = 65536 };

/* Divide the memory of the search among its lists. */
static void lay_out_intervals(Encounter *pair, Interval *memory) {
    pair->undecided.items = memory;
    pair->deeper.items = memory + MAX_INTERVALS_PER_PAIR;
    pair->spare_time.items = memory + 2 * MAX_INTERVALS_PER_PAIR;
}

/* Set the work budget of a pair. */
static void share_work(Encounter *pair, int64_t pairs_of_objects) {
    int64_t share = MAX_INTERVALS / (pairs_of_objects > 1 ? pairs_of_objects : 1), most = share;
    most = most < MIN_INTERVALS_PER_PAIR   ? MIN_INTERVALS_PER_PAIR
           : most > MAX_INTERVALS_PER_PAIR ? MAX_INTERVALS_PER_PAIR
                                           : most;
    pair->undecided.most = pair->deeper.most = pair->spare_time.most = most;
    pair->looks_left = share > MAX_INTERVALS_PER_PAIR ? share : MAX_INTERVALS_PER_PAIR;
    if (pair->looks_left < 2 * most) pair->looks_left = 2 * most;
    int64_t parts = PLANE_MAX_PARTS / (pairs_of_objects > 1 ? pairs_of_objects : 1);
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

KernelStatus contacts_begin(const KernelScene *scene, const KernelPairs *pairs, int64_t times, double separation_m,
                            double tolerance_m, KernelWork *work, Contacts *made) {
    *made = (Contacts){.pair = {.separation_m = separation_m, .margin_m = tolerance_m, .work = work}};
    KernelStatus status = border_begin_larger(scene, pairs, times, &made->pair, &made->memory);
    if (status != KERNEL_OK) return status;
    made->intervals = malloc(3 * MAX_INTERVALS_PER_PAIR * sizeof *made->intervals);
    made->answers.is_full = !made->intervals;
    encounter_ask(&made->pair, separation_m, tolerance_m);
    if (made->intervals) lay_out_intervals(&made->pair, made->intervals);
    else contacts_end(made);
    return made->intervals ? KERNEL_OK : KERNEL_NO_MEMORY;
}

void contacts_end(Contacts *made) {
    free(made->memory), free(made->intervals), free(made->answers.items);
    *made = (Contacts){0};
}

void contacts_find(Contacts *made, bool is_valid, double low, double high, double beyond, int64_t pairs_of_objects,
                   const Guess *guess) {
    int64_t before = made->answers.count;
    share_work(&made->pair, pairs_of_objects);
    is_valid = is_valid && low <= high;
    if (is_valid) find_contacts(&made->pair, low, high, beyond, guess, &made->answers);
    if (is_valid && made->pair.parts_left >= 0) return;
    /* Contacts found without all distances are invalid. */
    made->answers.count = before;
    answers_add(&made->answers, low, high, high - low, KERNEL_UNRESOLVED, true);
}

KernelStatus kernel_contacts(const KernelScene *scene, const KernelPairs *pairs, const KernelQuestion *question,
                             KernelContact **contacts, int64_t *count, KernelWork *work) {
    if (!question || !contacts || !count || !work) return KERNEL_NULL;
    Contacts made;
    *contacts = NULL, *count = 0, *work = (KernelWork){0};
    KernelStatus status = contacts_begin(scene, pairs, 1, question->separation_m, question->tolerance_m, work, &made);
    if (status != KERNEL_OK) return status;
    double began_s = encounter_clock_s();
    for (int64_t i = 0; i < pairs->count && !made.answers.is_full; i++) {
        double low = pairs->low_s[i], high = pairs->high_s[i], beyond = question->beyond_s ? question->beyond_s[i] : INFINITY;
        int64_t shared = question->pairs_of_objects ? question->pairs_of_objects[i] : 1;
        Guess guess = {question->guess, question->guess_of, i};
        made.answers.pair = i;
        bool is_valid = low <= high && border_meet(scene, pairs, i, &made.pair);
        contacts_find(&made, is_valid, low, high, beyond, shared, &guess);
    }
    encounter_set_closed_form(&made.pair, false);
    work->contacts_s = encounter_clock_s() - began_s;
    if (made.answers.is_full) status = KERNEL_NO_MEMORY;
    else *contacts = made.answers.items, *count = made.answers.count, made.answers.items = NULL;
    contacts_end(&made);
    return status;
}
