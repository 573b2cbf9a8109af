/* Decide whether a pair conflicts, and when (find_contacts): from the proof of certain.c, else by a search (stage 4).
 * is_shallow decides between conflict and grazing for both. Steps of the search:
 *
 * 1. Prove the pair apart at most times; the rest is undecided.
 * 2. Bracket the first and the last contact on the true motion, between an instant apart and one in contact. A guess
 *    may say where to look.
 * 3. Prove the pair apart before the first contact and after the last; where that fails, search farther out.
 * 4. Bound the errors of both ends, and decide the verdict: conflict, or grazing if the smallest clearance is within the
 *    margin of zero. A pair that stays undecided is unresolved, for the time in which contact is possible.
 * 5. Prove that the contact lasts; cut it in two where the pair is apart in between. Both parts get that verdict.
 */
#include "narrow/search.h"

#include "narrow/certain.h"
#include "narrow/proofs.h"
#include "geometry/roots.h"

/* Clearance at the outer end of a contact, metres on the earth: certainly no touch. Smaller: an end may lie within
 * rounding; larger: contacts are reported too long. */
static const double CLEAR_M = 3.0 * KERNEL_TOUCH_M;
/* A contact that begins within this of an excluded end of the span counts only if it is certain at that end, seconds:
 * half a microsecond, as it would be rounded to the end. */
static const double END_RESOLUTION_S = 5e-7;
/* Half widths of the brackets tried around a guess, seconds, before the whole time. They change the work only. */
static const double GUESS_BRACKETS_S[] = {1e-3, 0.1, 10.0};
enum { GUESS_BRACKETS = sizeof GUESS_BRACKETS_S / sizeof *GUESS_BRACKETS_S };
/* Most contacts farther out that the search moves to, and most cuts of a pair's contacts. Smaller: wider bounds for
 * pairs that meet many times. */
enum { MAX_ROUNDS = 16, MAX_CUTS = 32 };
/* Intervals inspected for the depth of a contact. Smaller: more contacts hardly deeper than the tolerance are
 * conflicts. */
enum { DEPTH_INTERVALS = 64 };
/* A touch in doubt is searched again if the time in doubt shrank to this fraction. Smaller: more touches stay in doubt;
 * larger: touches within rounding take more work. */
static const double SHRUNK = 0.75;
/* Growth of the steps from a contact's end to a certain instant. Larger: short contacts are passed over. */
static const double STEP_GROWTH = 4.0;

/* The first and the last of some instants. */
typedef struct {
    double first, last;
} Span;

static const Span NEVER = {INFINITY, -INFINITY};

static void extend(Span *span, double first, double last) {
    span->first = least(span->first, first), span->last = most(span->last, last);
}

/* The hull of all intervals; and of the instants `at` with a given reason. */
static Span hull_of(const Intervals *intervals) {
    Span hull = NEVER;
    for (int64_t i = 0; i < intervals->count; i++) extend(&hull, intervals->items[i].start, intervals->items[i].end);
    return hull;
}

static Span witnesses_of(const Intervals *intervals, Reason reason) {
    Span seen = NEVER;
    for (int64_t i = 0; i < intervals->count; i++)
        if (intervals->items[i].reason == reason) extend(&seen, intervals->items[i].at, intervals->items[i].at);
    return seen;
}

static bool is_seen(Span span) { return span.first <= span.last; }

/* Whether the budget was exhausted before an undecided interval was as short as a microsecond; and one of a list. */
static bool is_cut_short(Interval one) { return one.reason == BORDERLINE && one.end - one.start > 2.0 * SHORTEST_INTERVAL_S; }

static bool is_exhausted(const Intervals *intervals) {
    for (int64_t i = 0; i < intervals->count; i++)
        if (is_cut_short(intervals->items[i])) return true;
    return false;
}

/* An end of a contact: no contact beyond `outer`; in contact at `witness`. */
typedef struct {
    double outer, witness;
} OuterEnd;

/* A contact: within [start, end]; in contact at first and last; certain from start + start_error to end - end_error. */
typedef struct {
    double start, end, first, last, start_error, end_error;
} Found;

/* The clearance as a function of time for root finding: exact only near contact. */
static double clearance(void *pair, double t) { return encounter_clearance_m(pair, t, CLEAR_M); }

/* A bracket around a guess of the extreme contact; without one, from the limit to the witness. */
static Span bracket(Encounter *pair, const Guess *guess, double limit, double witness, bool is_last) {
    double low = least(limit, witness), high = most(limit, witness), out = is_last ? 1.0 : -1.0;
    double at = guess && guess->ask ? guess->ask(guess->of, guess->pair, low, high, is_last) : NAN;
    for (int k = 0; isfinite(at) && k < GUESS_BRACKETS; k++) {
        double outward = most(low, least(high, at + out * GUESS_BRACKETS_S[k]));
        double inward = most(low, least(high, at - out * GUESS_BRACKETS_S[k]));
        if (clearance(pair, outward) > CLEAR_M && clearance(pair, inward) <= KERNEL_TOUCH_M) return (Span){outward, inward};
    }
    return (Span){limit, witness};
}

/* The first (or last) instant of contact, given that no contact lies beyond the limit. */
static OuterEnd outer_end(Encounter *pair, const Guess *guess, double limit, double witness, bool is_last) {
    OuterEnd end = {limit, witness};
    if (!(clearance(pair, limit) > CLEAR_M)) return end;
    for (int round = 0; round < MAX_ROUNDS; round++) {
        Span within = bracket(pair, guess, limit, end.witness, is_last);
        end.outer = crossing_between(clearance, pair, CLEAR_M, within.first, within.last).outer;
        undecided_separation_in(pair, &pair->spare_time, least(end.outer, limit), most(end.outer, limit), 0.0);
        bool is_further = false;
        for (int64_t i = 0; i < pair->spare_time.count; i++) {
            Interval rest = pair->spare_time.items[i];
            if (rest.reason == IN_CONTACT) {
                end.witness = is_last ? most(end.witness, rest.at) : least(end.witness, rest.at), is_further = true;
            } else {
                /* An interval next to the contact within rounding of a touch belongs to the contact. */
                end.outer = is_last ? most(end.outer, rest.end) : least(end.outer, rest.start);
            }
        }
        if (!is_further) return end;
        if (pair->looks_left <= 0) break;
    }
    /* The budget is exhausted, and each round found a contact farther out: report all times up to the limit. */
    end.outer = limit;
    return end;
}

/* Seconds from the outer end of a contact to where it is certain; its whole duration if nowhere.
 *
 * Certain: the clearance is at most minus the certainty margin. Coordinates are rounded by less than KERNEL_TOUCH_M,
 * and distances are understated by at most their error.
 */
static double uncertain_s(Encounter *pair, const Found *found, double outer, double witness) {
    double length = found->end - found->start, deep = -encounter_certainty_margin_m(pair);
    double inward = outer == found->start ? 1.0 : -1.0;
    if (clearance(pair, outer) <= deep) return 0.0;
    /* Near the end first: a certain instant farther in may belong to another contact. */
    for (double step = SHORTEST_INTERVAL_S; step < length; step *= STEP_GROWTH) {
        double at = outer + inward * step;
        if (clearance(pair, at) <= deep) return fabs(crossing_between(clearance, pair, deep, outer, at).inner - outer);
    }
    if (clearance(pair, witness) <= deep) return fabs(crossing_between(clearance, pair, deep, outer, witness).inner - outer);
    undecided_separation_in(pair, &pair->spare_time, found->start, found->end, deep);
    Span certain = witnesses_of(&pair->spare_time, IN_CONTACT);
    if (!is_seen(certain)) return length;
    double at = inward > 0.0 ? certain.first : certain.last;
    return fabs(crossing_between(clearance, pair, deep, outer, at).inner - outer);
}

static void state_errors(Encounter *pair, Found *found) {
    found->start_error = uncertain_s(pair, found, found->start, found->first);
    found->end_error = uncertain_s(pair, found, found->end, found->last);
}

/* Whether a contact that begins at an instant, at the earliest, is only at the excluded instant at the end of the span. The
 * clearance at the end does not show when contact begins: it may be zero to rounding where a long contact ends. */
static bool is_only_at_end(Encounter *pair, double begins, double beyond) {
    if (!(begins > 0.0 && begins >= beyond - END_RESOLUTION_S)) return false;
    return !(clearance(pair, beyond) < -encounter_certainty_margin_m(pair));
}

/* The first instant of a contact, but for what touches within rounding before. */
static double first_instant(Encounter *pair, const Found *found) {
    double level = most(clearance(pair, found->first), 0.0);
    return crossing_between(clearance, pair, level, found->start, found->first).inner;
}

/* Whether the pair is nowhere deep enough to be in conflict.
 *
 * A certain contact may become a conflict if its depth is not decided soon: depth in plane metres determines that on
 * the earth only up to the variation of the scale along the polygons, and splitting the time does not help.
 */
static bool is_shallow(Encounter *pair, double start, double end, bool is_certain) {
    if (encounter_clearance_m(pair, 0.5 * (start + end), 0.0) < -pair->deep_m) return false;
    Intervals looks = pair->spare_time;
    bool is_soon = is_certain && pair->deep_m > encounter_certainty_margin_m(pair);
    if (is_soon) looks.most = DEPTH_INTERVALS;
    undecided_separation_in(pair, &looks, start, end, -pair->deep_m);
    if (is_seen(witnesses_of(&looks, IN_CONTACT))) return false;
    for (int64_t i = 0; is_soon && i < looks.count; i++)
        if (looks.items[i].end - looks.items[i].start > 2.0 * SHORTEST_INTERVAL_S) return false;
    return true;
}

/* If distances are not known to the tolerance, a shallow contact may be none. */
static KernelVerdict shallow_verdict(const Encounter *pair) {
    return pair->deep_m == pair->margin_m ? KERNEL_GRAZING : KERNEL_UNRESOLVED;
}

/* Add a contact, cut where the pair is apart. Each part is proven to last, except while the pair only touches, within
 * rounding. */
static void add_cut(Encounter *pair, Found whole, KernelVerdict verdict, Answers *answers) {
    Found stack[MAX_CUTS + 1] = {whole};
    int top = 1, cuts = 0;
    while (top > 0) {
        Found found = stack[--top];
        double error = most(found.start_error, found.end_error);
        /* The uncertain seconds at either end are reported as the error. */
        double first = found.start + found.start_error, last = most(found.end - found.end_error, first), at = NAN;
        undecided_contact(pair, &pair->spare_time, first, last);
        for (int64_t i = 0; i < pair->spare_time.count; i++)
            if (pair->spare_time.items[i].reason == NEARBY) at = pair->spare_time.items[i].at;
        if (isnan(at) || last - first <= SHORTEST_INTERVAL_S) {
            answers_add(answers, found.start, found.end, error, verdict, true);
            continue;
        }
        if (cuts++ >= MAX_CUTS || pair->looks_left <= 0) {
            answers_add(answers, found.start, found.end, found.end - found.start, verdict, true);
            continue;
        }
        OuterEnd before = outer_end(pair, NULL, at, first, true), after = outer_end(pair, NULL, at, last, false);
        Found earlier = {.start = found.start, .end = before.outer, .first = first, .last = before.witness};
        Found later = {.start = after.outer, .end = found.end, .first = after.witness, .last = last};
        state_errors(pair, &earlier);
        state_errors(pair, &later);
        /* The earlier contact is popped first. */
        stack[top++] = later;
        stack[top++] = earlier;
    }
}

/* Add a pair that is not seen in contact, but comes within the margin, or touches: grazing or unresolved. */
static void add_close(Encounter *pair, const Intervals *intervals, bool touches, Answers *answers) {
    if (intervals->count == 0) return;
    Span hull = hull_of(intervals), seen = witnesses_of(intervals, NEARBY);
    Intervals *rest = &pair->spare_time;
    bool is_unresolved = false;
    /* An undecided interval of a microsecond lies within rounding of the margin: grazing. A longer one exhausted the
     * budget: grazing if its clearance is proven above minus the margin. */
    rest->count = 0;
    for (int64_t i = 0; i < intervals->count; i++)
        if (is_cut_short(intervals->items[i])) rest->items[rest->count++] = intervals->items[i];
    undecided_separation(pair, rest, -pair->margin_m);
    if (rest->count > 0) is_unresolved = true;
    if (pair->separation_m > 0.0) {
        /* Check that it comes within the margin despite the error of distances. */
        double error_m = encounter_distance_error_m(pair, pair->separation_m + pair->margin_m);
        rest->count = 0;
        for (int64_t i = 0; i < intervals->count; i++) rest->items[rest->count++] = intervals->items[i];
        undecided_separation(pair, rest, pair->margin_m - error_m);
        bool is_close = is_seen(witnesses_of(rest, IN_CONTACT)) || is_seen(witnesses_of(rest, NEARBY));
        if (!is_close) is_unresolved = true;
    }
    double error = hull.last - hull.first;
    if (is_seen(seen) && !is_unresolved) error = most(seen.first - hull.first, hull.last - seen.last);
    answers_add(answers, hull.first, hull.last, error, is_unresolved ? KERNEL_UNRESOLVED : KERNEL_GRAZING, touches);
}

/* Add a pair without contact within its span: it is close if the margin is more than rounding. */
static void add_close_within_margin(Encounter *pair, Answers *answers) {
    if (pair->margin_m > KERNEL_TOUCH_M) add_close(pair, &pair->undecided, false, answers);
}

/* Add a pair in contact. hull: contains all contacts; seen: first and last known instants of contact. */
static void add_contacts(Encounter *pair, Span hull, Span seen, double beyond, const Guess *guess, Answers *answers) {
    /* Find both outer ends. */
    OuterEnd start = outer_end(pair, guess, hull.first, seen.first, false);
    OuterEnd end = outer_end(pair, guess, hull.last, seen.last, true);
    Found found = {.start = start.outer, .end = end.outer, .first = start.witness, .last = end.witness};
    if (found.end >= beyond && is_only_at_end(pair, first_instant(pair, &found), beyond)) {
        add_close_within_margin(pair, answers);
        return;
    }
    /* Bound the errors, decide the verdict, and prove that the contact lasts. */
    state_errors(pair, &found);
    bool is_certain = found.start_error < found.end - found.start;
    KernelVerdict verdict = is_shallow(pair, found.start, found.end, is_certain) ? shallow_verdict(pair) : KERNEL_CONFLICT;
    add_cut(pair, found, verdict, answers);
}

/* Search intervals for contact; return its first and last known instants. A full list leaves a shorter time undecided,
 * which an empty list splits further: repeat while that helps, and keep half of the budget for the next steps. */
static Span search_for_touch(Encounter *pair, Intervals *intervals) {
    Intervals list = *intervals;
    Span rest = hull_of(&list), seen = NEVER;
    bool helps = true;
    while (helps && !is_seen(seen) && list.most > 0) {
        Span before = rest;
        undecided_separation(pair, &list, 0.0);
        seen = witnesses_of(&list, IN_CONTACT), rest = hull_of(&list);
        helps = is_exhausted(&list) && rest.last - rest.first <= SHRUNK * (before.last - before.first);
        if (list.most > pair->looks_left / 2) list.most = pair->looks_left / 2;
    }
    intervals->count = list.count;
    return seen;
}

/* Add a pair that is not seen in contact. close: not proven farther apart than the margin; touching: nor proven apart. */
static void add_unseen(Encounter *pair, const Intervals *close, const Intervals *touching, double beyond, Answers *answers) {
    bool touches = touching->count > 0;
    const Intervals *left = touches ? touching : close;
    if (left->count == 0) return;
    bool is_rounding = touches || pair->margin_m <= KERNEL_TOUCH_M;
    if (is_rounding && is_only_at_end(pair, hull_of(left).first, beyond)) add_close_within_margin(pair, answers);
    else add_close(pair, left, touches, answers);
}

static void search_contacts(Encounter *pair, double low, double high, double beyond, const Guess *guess, Answers *answers) {
    Intervals *undecided = &pair->undecided, *deeper = &pair->deeper;
    pair->work->searched_pairs++;
    /* Prove the pair apart at most times. */
    undecided_separation_in(pair, undecided, low, high, pair->margin_m);
    Span seen = witnesses_of(undecided, IN_CONTACT);
    deeper->count = 0;
    if (!is_seen(seen)) {
        /* Only closeness was found: search those intervals for contact. */
        for (int64_t i = 0; i < undecided->count; i++) deeper->items[deeper->count++] = undecided->items[i];
        seen = search_for_touch(pair, deeper);
    }
    if (is_seen(seen)) add_contacts(pair, hull_of(undecided), seen, beyond, guess, answers);
    else add_unseen(pair, undecided, deeper, beyond, answers);
}

/* Add what is proven without a search; false if that is not everything. */
static bool add_certain(Encounter *pair, double low, double high, double beyond, Answers *answers) {
    Contact contact = certain_contact(pair, low, high);
    if (contact.outcome == IS_SEPARATED) return true;
    /* A contact that begins at the end of the span may not belong to it. */
    if (contact.outcome == IS_UNDECIDED || !(contact.start < beyond - 2.0 * END_RESOLUTION_S)) return false;
    if (contact.outcome == IS_CLOSE) {
        /* Within rounding of a touch it may be one. */
        if (pair->margin_m <= KERNEL_TOUCH_M) return false;
        answers_add(answers, contact.start, contact.end, contact.error, KERNEL_GRAZING, false);
        return true;
    }
    bool is_deep = contact.depth == IS_DEEP;
    if (contact.depth == IS_EITHER) is_deep = !is_shallow(pair, contact.start, contact.end, true);
    answers_add(answers, contact.start, contact.end, contact.error, is_deep ? KERNEL_CONFLICT : shallow_verdict(pair), true);
    return true;
}

void find_contacts(Encounter *pair, double low, double high, double beyond, const Guess *guess, Answers *answers) {
    int64_t before = answers->count;
    bool is_certain = !guess->ask && add_certain(pair, low, high, beyond, answers);
    if (!is_certain) {
        encounter_set_closed_form(pair, false);
        search_contacts(pair, low, high, beyond, guess, answers);
    } else if (pair->in_closed_form) {
        pair->work->closed_forms++;
        pair->work->closed_apart += answers->count == before;
    }
}
