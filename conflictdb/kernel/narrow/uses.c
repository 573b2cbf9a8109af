/* Uses of one place by two pieces of tracks within a separation in time, T.
 *
 * Pieces A and B use one place if A at u and B at v come within the separation for instants u and v at most T apart.
 *
 * 1. The differences v - u of contact within T decide that (differences.c).
 * 2. Contacts of A with B, shifted by such a difference, tell whether they are deeper than the tolerance.
 * 3. The first and the last time of either are found by bisection: differences prove for a part of a time that it comes to no
 *    place of the other within T, or that it does. Guesses of these times change the work, not the proof: they are where a
 *    piece meets all that the other sweeps, or where it meets the other shifted by T.
 */
#include <stdlib.h>

#include "narrow/contacts.h"
#include "narrow/differences.h"
#include "narrow/heights.h"
#include "narrow/meeting.h"
#include "scene/border.h"

/* More than times of pieces are rounded by, microseconds. */
static const double ROUNDING_US = 0.1;
/* Ends are found to this, seconds. Smaller: more steps, which cost more the nearer they are to the end. */
static const double AIM_S = 1e-3;
/* Factor between the times within which a contact next to an end is looked for. */
static const double LADDER = 10.0;
/* Shifts at which two tracks are tested for an overlap deeper than the tolerance: the middle one first. Clearance is nearly
 * convex in the shift, so that an overlap which is deeper by an eighth is found. */
enum { TESTS = 17 };
/* So far on either side of guesses a bisection goes first, seconds: rounding, curved sweeps, havens that change. */
enum { GUESSES = 3, ASIDES = 3, PLACES = 2 * ASIDES * GUESSES };
static const double ASIDE_S[ASIDES] = {4e-4, 0.05, 2.0};
/* The first and the last time of a, and of b. */
enum { A_FIRST, A_LAST, B_FIRST, B_LAST, ENDS };

typedef struct {
    double low, high;
} Range;

/* The first and the last contact of a time, seconds; NaN without one. */
typedef struct {
    double first, last;
} Period;

typedef struct {
    const KernelScene *scene;
    const KernelHeights *pieces;
    double separation_m, tolerance_m, within_us;
    Differences *differences[2]; /* within the separation, and within the tolerance of it */
    Contacts contacts;
    double *swept; /* room for the hull of a piece at both ends of its time, and what finds it */
    int64_t room;  /* vertices of that hull */
} Uses;

/* ---- Shifts that bring a pair into contact ---------------------------------------------------------------------- */

static Range outer_us(const KernelDifference *found, double between_us) {
    return (Range){1e6 * found->outer_low + between_us - ROUNDING_US, 1e6 * found->outer_high + between_us + ROUNDING_US};
}

static Range inner_us(const KernelDifference *found, double between_us) {
    return (Range){1e6 * found->inner_low + between_us + ROUNDING_US, 1e6 * found->inner_high + between_us - ROUNDING_US};
}

/* Whether a proven contact is within a time. */
static bool is_sure(const KernelDifference *found, double between_us, double within_us) {
    Range inner = inner_us(found, between_us);
    return found->state == KERNEL_DIFFERENCE_INNER && most(inner.low, -within_us) <= least(inner.high, within_us);
}

/* Whether a contact may be within a time. */
static bool is_possible(const KernelDifference *found, double between_us, double within_us) {
    Range outer = outer_us(found, between_us);
    return !(outer.low > within_us || outer.high < -within_us);
}

static double between_us(const Shifted *one) { return us_between(one->a_zero_us, one->b_zero_us); }

/* The differences of a pair that may come within a reach, in parts. A pair without a proven contact is asked again about all
 * differences: ends are sharper that way, and delays are asked so. Thus what they prove free is free. */
static int parts_within(Differences *differences, const Shifted *one, double within_us, ShiftedPart *parts) {
    ShiftedPart every[DIFFERENCES_PARTS];
    double between = between_us(one);
    int count = differences_in_parts(differences, one, parts);
    for (int k = 0; k < count; k++)
        if (is_sure(&parts[k].found, between, within_us)) return count;
    if (count == 0) return 0;
    Shifted asked = *one;
    asked.least = -INFINITY, asked.most = INFINITY;
    int all = differences_in_parts(differences, &asked, every);
    for (int k = 0; k < all; k++)
        if (is_possible(&every[k].found, between, within_us)) return count;
    return 0;
}

/* ---- Pairs of which b is earlier -------------------------------------------------------------------------------- */

static int64_t earlier(int64_t at_us, int64_t by_us) { return (int64_t)((uint64_t)at_us - (uint64_t)by_us); }

/* The time that both share if b is earlier by so much; false: none. */
static bool time_shared(const Uses *uses, int64_t a, int64_t b, int64_t by_us, int64_t *start, int64_t *end) {
    const KernelHeights *of = uses->pieces;
    int64_t b_start = earlier(of->start_us[b], by_us), b_end = earlier(of->end_us[b], by_us);
    *start = of->start_us[a] > b_start ? of->start_us[a] : b_start;
    *end = of->end_us[a] < b_end ? of->end_us[a] : b_end;
    return *start <= *end;
}

/* Set up the encounter of a with b, earlier by so much; false if a piece or a time is invalid. */
static bool meet(Uses *uses, int64_t a, int64_t b, int64_t by_us, int64_t zero_us, double high) {
    Encounter *pair = &uses->contacts.pair;
    Vector origin = uses->scene->bodies[a].origin;
    return border_move(uses->scene, a, zero_us, 0.0, high, origin, &pair->a) &&
           border_move(uses->scene, b, earlier(zero_us, -by_us), 0.0, high, origin, &pair->b);
}

/* Find contacts of the encounter that is set up during [0, high]. Returns their number. */
static int64_t contacts_of(Uses *uses, bool is_valid, double high, double separation_m, double tolerance_m) {
    Guess none = {NULL, NULL, 0};
    uses->contacts.answers.count = 0;
    encounter_ask(&uses->contacts.pair, separation_m, tolerance_m);
    contacts_find(&uses->contacts, is_valid, 0.0, high, INFINITY, 1, &none);
    return uses->contacts.answers.count;
}

/* The first and the last contact that was found. */
static Period times_of(const Uses *uses, int64_t count) {
    Period times = {INFINITY, -INFINITY};
    for (int64_t k = 0; k < count; k++) {
        times.first = least(times.first, uses->contacts.answers.items[k].start_s);
        times.last = most(times.last, uses->contacts.answers.items[k].end_s);
    }
    return times.first <= times.last ? times : (Period){NAN, NAN};
}

/* Whether a pair is deeper than the tolerance at some tested shift; KERNEL_UNRESOLVED: no contact was proven. */
static int32_t verdict_of(Uses *uses, const Shifted *one, Range shifts_us) {
    int32_t verdict = KERNEL_UNRESOLVED;
    for (int k = 0; k < TESTS && verdict != KERNEL_CONFLICT; k++) {
        double share = (double)((k + TESTS / 2) % TESTS) / (TESTS - 1);
        int64_t by_us = (int64_t)rint(shifts_us.low + share * (shifts_us.high - shifts_us.low)), start, end;
        if (!time_shared(uses, one->a, one->b, by_us, &start, &end)) continue;
        double high = us_between(start, end) / 1e6;
        bool is_valid = meet(uses, one->a, one->b, by_us, start, high);
        int64_t count = contacts_of(uses, is_valid, high, uses->separation_m, uses->tolerance_m);
        for (int64_t i = 0; i < count; i++) {
            int32_t found = uses->contacts.answers.items[i].verdict;
            if (found == KERNEL_CONFLICT || (found == KERNEL_GRAZING && verdict != KERNEL_CONFLICT)) verdict = found;
        }
    }
    return verdict;
}

/* ---- Guesses ---------------------------------------------------------------------------------------------------- */

/* Make the hull of a piece at both ends of its time a body that stands still, in a scene of its own; false if the piece is
 * invalid. */
static bool sweep(Uses *uses, int64_t piece, KernelScene *scene, Body *body) {
    Encounter *pair = &uses->contacts.pair;
    int64_t zero_us = uses->pieces->start_us[piece];
    double last = us_between(zero_us, uses->pieces->end_us[piece]) / 1e6, *memory = uses->swept;
    Polygon hull = {.x = memory, .y = memory + uses->room}, spare = {.x = memory + 2 * uses->room};
    spare.y = spare.x + 2 * uses->room;
    if (!border_move(uses->scene, piece, zero_us, 0.0, last, (Vector){0.0, 0.0}, &pair->b)) return false;
    int64_t count = pair->b.body->count;
    Polygon end = {.x = hull.x + count, .y = hull.y + count};
    mover_place(&pair->b, 0.0, &hull), mover_place(&pair->b, last, &end);
    hull.count = 2 * count;
    polygon_hull(&hull, &spare);
    bool is_sound = true;
    for (int64_t k = 0; k < hull.count; k++) is_sound &= isfinite(hull.x[k]) && isfinite(hull.y[k]);
    *body = (Body){.motion = STANDS_STILL, .is_sound = is_sound, .is_convex = true, .count = hull.count};
    body->origin = (Vector){hull.x[0], hull.y[0]};
    *scene =
        (KernelScene){.plane = uses->scene->plane, .count = 1, .vertex_count = uses->room, .bodies = body, .columns = memory};
    return is_sound;
}

/* When a piece meets all that another one sweeps, seconds of its time. */
static Period times_at_sweep(Uses *uses, int64_t one, int64_t other, double reach_m) {
    KernelScene scene;
    Body body;
    Encounter *pair = &uses->contacts.pair;
    int64_t start = uses->pieces->start_us[one], end = uses->pieces->end_us[one];
    Vector origin = uses->scene->bodies[one].origin;
    double high = us_between(start, end) / 1e6;
    if (start > end) return (Period){NAN, NAN};
    bool is_valid = sweep(uses, other, &scene, &body) && border_move(&scene, 0, 0, 0.0, high, origin, &pair->b) &&
                    border_move(uses->scene, one, start, 0.0, high, origin, &pair->a);
    return times_of(uses, contacts_of(uses, is_valid, high, reach_m, 0.0));
}

/* Where the ends of contact within T may be, seconds; NaN if unknown. */
static void guess_ends(Uses *uses, const Shifted *one, double reach_m, double guess[GUESSES][ENDS]) {
    Period a = times_at_sweep(uses, one->a, one->b, reach_m), b = times_at_sweep(uses, one->b, one->a, reach_m);
    guess[0][A_FIRST] = a.first, guess[0][A_LAST] = a.last, guess[0][B_FIRST] = b.first, guess[0][B_LAST] = b.last;
    for (int k = 1; k < GUESSES; k++) {
        int64_t by_us = (int64_t)(k == 1 ? uses->within_us : -uses->within_us), start, end;
        Period both = {NAN, NAN};
        if (time_shared(uses, one->a, one->b, by_us, &start, &end)) {
            double high = us_between(start, end) / 1e6;
            bool is_valid = meet(uses, one->a, one->b, by_us, start, high);
            both = times_of(uses, contacts_of(uses, is_valid, high, reach_m, 0.0));
        }
        double of_a = us_between(one->a_zero_us, start) / 1e6;
        double of_b = us_between(earlier(one->b_zero_us, by_us), start) / 1e6;
        guess[k][A_FIRST] = of_a + both.first, guess[k][A_LAST] = of_a + both.last;
        guess[k][B_FIRST] = of_b + both.first, guess[k][B_LAST] = of_b + both.last;
    }
}

/* ---- Ends ------------------------------------------------------------------------------------------------------- */

/* What a pair meets during so much of one time from its start, or before its end. */
static KernelDifference met_during(Differences *differences, const Shifted *one, int end, double gone_s) {
    Shifted part = *one;
    if (end == A_FIRST) part.a_end_s = least(one->a_start_s + gone_s, one->a_end_s);
    if (end == A_LAST) part.a_start_s = most(one->a_end_s - gone_s, one->a_start_s);
    if (end == B_FIRST) part.b_end_s = least(one->b_start_s + gone_s, one->b_end_s);
    if (end == B_LAST) part.b_start_s = most(one->b_end_s - gone_s, one->b_start_s);
    return differences_met(differences, &part);
}

/* Places on either side of guesses, seconds of the time that is gone; in order, without NaN. Returns their number. */
static int places_of(const double guess[GUESSES][ENDS], int end, double start, double stop, double places[PLACES]) {
    int count = 0;
    for (int k = 0; k < GUESSES; k++) {
        double at = end % 2 == 0 ? guess[k][end] - start : stop - guess[k][end];
        for (int side = 0; side < 2 * ASIDES && !isnan(at); side++) {
            double place = side < ASIDES ? at - ASIDE_S[side] : at + ASIDE_S[side - ASIDES];
            int n = count++;
            for (; n > 0 && places[n - 1] > place; n--) places[n] = places[n - 1];
            places[n] = place;
        }
    }
    return count;
}

/* Where to part a time: at the middle one of the places within, or else in its middle. */
static double parted(const double *places, int count, double low, double high) {
    int first = 0, within = 0;
    for (int k = count - 1; k >= 0; k--)
        if (low < places[k] && places[k] < high) first = k, within++;
    return within > 0 ? places[first + within / 2] : 0.5 * (low + high);
}

/* One end of contact within T, seconds of its piece, and its error. */
static double end_of(Differences *differences, const Shifted *one, int end, double within_us, const double guess[GUESSES][ENDS],
                     double *error_s) {
    double start = end < B_FIRST ? one->a_start_s : one->b_start_s, stop = end < B_FIRST ? one->a_end_s : one->b_end_s;
    double places[PLACES], between = between_us(one), length = stop - start, low = 0.0, high = length;
    int count = places_of(guess, end, start, stop, places);
    if (met_during(differences, one, end, 0.0).state != KERNEL_DIFFERENCE_NONE) high = 0.0;
    while (high - low > AIM_S) {
        double middle = parted(places, count, low, high);
        if (!(low < middle && middle < high)) break;
        if (met_during(differences, one, end, middle).state == KERNEL_DIFFERENCE_NONE) low = middle;
        else high = middle;
    }
    double until = high;
    for (double step = 0.0;; step = most(LADDER * step, AIM_S)) {
        until = least(high + step, length);
        KernelDifference found = met_during(differences, one, end, until);
        double first = 1e6 * found.inner_low + between, last = 1e6 * found.inner_high + between;
        if (most(first, ROUNDING_US - within_us) <= least(last, within_us - ROUNDING_US) || until >= length) break;
    }
    *error_s = most(*error_s, until - low);
    return end % 2 == 0 ? start + low : stop - low;
}

/* ---- One pair --------------------------------------------------------------------------------------------------- */

/* Where the use begins: the place of the first piece that is where the other will be. */
static void put_first(Uses *uses, Differences *differences, const Shifted *one, const double ends[ENDS], double error_s,
                      KernelUse *use) {
    double between = between_us(one), degrees[2] = {NAN, NAN};
    bool is_a = 1e6 * (ends[A_FIRST] - ends[B_FIRST]) <= between;
    Shifted part = *one;
    if (is_a) part.a_start_s = least(ends[A_FIRST], one->a_end_s), part.a_end_s = least(ends[A_FIRST] + error_s, one->a_end_s);
    else part.b_start_s = least(ends[B_FIRST], one->b_end_s), part.b_end_s = least(ends[B_FIRST] + error_s, one->b_end_s);
    KernelDifference found = differences_met(differences, &part);
    double low = isfinite(found.outer_low) ? found.outer_low : 0.0, high = isfinite(found.outer_high) ? found.outer_high : 0.0;
    if (found.state == KERNEL_DIFFERENCE_INNER) low = found.inner_low, high = found.inner_high;
    double by = most(-uses->within_us, least(rint(0.5e6 * (low + high)) + between, uses->within_us));
    int64_t by_us = (int64_t)by, start, end, begins_us = (int64_t)rint(1e6 * (is_a ? ends[A_FIRST] : ends[B_FIRST]));
    bool is_shared = time_shared(uses, one->a, one->b, by_us, &start, &end);
    int64_t at = earlier(is_a ? one->a_zero_us : one->b_zero_us, -begins_us), first = is_shared ? start : end;
    int64_t last = is_shared ? end : start;
    if (!is_a) at = earlier(at, by_us);
    at = at < first ? first : at > last ? last : at;
    if (meet(uses, one->a, one->b, by_us, at, 0.0)) {
        Vector place = encounter_meeting(&uses->contacts.pair, 0.0);
        plane_degrees(&uses->scene->plane, place, degrees);
    }
    use->first_lon_deg = degrees[0], use->first_lat_deg = degrees[1];
}

static int64_t instant_at(int64_t zero_us, double rounded_us) {
    bool is_known = fabs(rounded_us) < 0x1p62; /* also of NaN */
    return is_known ? earlier(zero_us, -(int64_t)rounded_us) : zero_us;
}

/* The use of a pair within a reach; false: there is none. `touches`: within the separation, else the tolerance of it. */
static bool use_within(Uses *uses, const Shifted *one, bool touches, KernelUse *use) {
    Differences *differences = uses->differences[!touches];
    double reach_m = touches ? uses->separation_m : uses->separation_m + uses->tolerance_m;
    double within = uses->within_us, between = between_us(one), gap = INFINITY, sure_gap = INFINITY;
    ShiftedPart parts[DIFFERENCES_PARTS];
    Range widest = {0.0, -1.0};
    int count = parts_within(differences, one, within, parts);
    if (count == 0) return false;
    for (int k = 0; k < count; k++) {
        Range outer = outer_us(&parts[k].found, between), inner = inner_us(&parts[k].found, between);
        outer.low = most(-within, least(outer.low, within)), outer.high = most(-within, least(outer.high, within));
        gap = least(gap, most(0.0, most(outer.low, -outer.high)));
        if (is_sure(&parts[k].found, between, within)) sure_gap = least(sure_gap, most(0.0, most(inner.low, -inner.high)));
        if (outer.high - outer.low >= widest.high - widest.low) widest = outer;
    }
    int32_t verdict = verdict_of(uses, one, widest);
    if (verdict != KERNEL_CONFLICT && isfinite(sure_gap)) verdict = KERNEL_GRAZING;
    /* Heights at two times: the tests know those of whole slices. */
    if (!heights_surely_overlap(uses->pieces, one->a, one->b)) verdict = KERNEL_UNRESOLVED;
    double guess[GUESSES][ENDS], ends[ENDS], error_s = 0.0;
    guess_ends(uses, one, reach_m, guess);
    for (int end = 0; end < ENDS; end++) ends[end] = end_of(differences, one, end, within, guess, &error_s);
    /* A track is proven apart before its first time and after its last one. If these parts cover all of its time, the pair is
     * apart: its whole was not proven so, and both parts are. Against a proven contact it stays inverted, which
     * kernel_use_times makes unresolved. */
    bool is_inverted = ends[A_FIRST] > ends[A_LAST] || ends[B_FIRST] > ends[B_LAST];
    if (is_inverted && !isfinite(sure_gap) && verdict != KERNEL_CONFLICT) return false;
    bool is_open = verdict == KERNEL_UNRESOLVED;
    double lacking_s = most(rint(within - gap), 0.0) / 1e6;
    *use = (KernelUse){
        .a_start_us = instant_at(one->a_zero_us, floor(1e6 * ends[A_FIRST])),
        .a_end_us = instant_at(one->a_zero_us, ceil(1e6 * ends[A_LAST])),
        .b_start_us = instant_at(one->b_zero_us, floor(1e6 * ends[B_FIRST])),
        .b_end_us = instant_at(one->b_zero_us, ceil(1e6 * ends[B_LAST])),
        .error_s = error_s,
        .lacking_s = is_open ? NAN : lacking_s,
        .lacking_error_s = is_open ? NAN : least((sure_gap - gap + 1.0) / 1e6, lacking_s),
        .verdict = verdict,
        .touches = touches,
        .is_use = 1,
    };
    put_first(uses, differences, one, ends, error_s, use);
    return true;
}

/* A pair of tracks, asked about differences within T. */
static Shifted shifted_of(const Uses *uses, int64_t a, int64_t b) {
    const KernelHeights *of = uses->pieces;
    double between = us_between(of->start_us[a], of->start_us[b]), within = uses->within_us + ROUNDING_US;
    return (Shifted){
        .a = a,
        .b = b,
        .a_zero_us = of->start_us[a],
        .b_zero_us = of->start_us[b],
        .a_end_s = us_between(of->start_us[a], of->end_us[a]) / 1e6,
        .b_end_s = us_between(of->start_us[b], of->end_us[b]) / 1e6,
        .least = (-within - between) / 1e6,
        .most = (within - between) / 1e6,
        .weight = 1.0,
    };
}

static KernelStatus begin(Uses *uses, const KernelPairs *pairs, KernelWork *work) {
    double reach_m = uses->separation_m + uses->tolerance_m;
    KernelStatus status = contacts_begin(uses->scene, pairs, 2, uses->separation_m, uses->tolerance_m, work, &uses->contacts);
    if (status == KERNEL_OK) status = differences_begin(uses->scene, pairs, uses->separation_m, work, uses->differences);
    if (status == KERNEL_OK) status = differences_begin(uses->scene, pairs, reach_m, work, uses->differences + 1);
    if (status != KERNEL_OK) return status;
    uses->room = uses->contacts.pair.a0.y - uses->contacts.pair.a0.x;
    uses->swept = malloc(6 * (size_t)uses->room * sizeof *uses->swept);
    return uses->swept ? KERNEL_OK : KERNEL_NO_MEMORY;
}

KernelStatus kernel_uses(const KernelScene *scene, const KernelHeights *pieces, const KernelUsesAsked *asked, KernelUse *uses,
                         KernelWork *work) {
    if (!scene || !asked || !work) return KERNEL_NULL;
    KernelStatus status = heights_check(pieces, asked->a, asked->b, asked->count);
    if (status != KERNEL_OK) return status;
    if (pieces->count != scene->count || asked->within_us < 0 || asked->within_us > KERNEL_LATEST_US) return KERNEL_BAD_COUNT;
    if (asked->count > 0 && !uses) return KERNEL_NULL;
    *work = (KernelWork){0};
    Uses made = {.scene = scene, .pieces = pieces, .separation_m = asked->separation_m, .tolerance_m = asked->tolerance_m};
    made.within_us = (double)asked->within_us;
    /* Checked above; each pair has times of its own. */
    const double *unread = pieces->floor_m;
    KernelPairs pairs = {asked->count, asked->a, asked->b, pieces->start_us, unread, unread};
    status = begin(&made, &pairs, work);
    for (int64_t i = 0; status == KERNEL_OK && i < asked->count; i++) {
        Shifted one = shifted_of(&made, asked->a[i], asked->b[i]);
        uses[i] = (KernelUse){0};
        heights_cut(pieces, &one);
        if (!(one.a_start_s <= one.a_end_s && one.b_start_s <= one.b_end_s)) continue;
        if (!use_within(&made, &one, true, uses + i) && made.tolerance_m > 0.0) use_within(&made, &one, false, uses + i);
        if (made.contacts.answers.is_full) status = KERNEL_NO_MEMORY;
    }
    encounter_set_closed_form(&made.contacts.pair, false);
    differences_end(made.differences[0]), differences_end(made.differences[1]);
    contacts_end(&made.contacts);
    free(made.swept);
    return status;
}

KernelStatus kernel_near_in_time(const KernelScene *scene, const KernelShifts *shifts, double reach_m, int64_t within_us,
                                 int8_t *near, KernelWork *work) {
    Differences *made;
    if (within_us < 0 || within_us > KERNEL_LATEST_US) return KERNEL_BAD_COUNT;
    if (shifts && shifts->count > 0 && !near) return KERNEL_NULL;
    KernelStatus status = differences_begin_shifts(scene, shifts, reach_m, work, &made);
    if (status != KERNEL_OK) return status;
    for (int64_t i = 0; i < shifts->count; i++) {
        ShiftedPart parts[DIFFERENCES_PARTS];
        Shifted one = differences_asked(shifts, i);
        double between = between_us(&one), within = (double)within_us;
        int count = parts_within(made, &one, within, parts);
        near[i] = KERNEL_NEAR_NONE;
        for (int k = 0; k < count && near[i] != KERNEL_NEAR_SURE; k++) {
            if (is_sure(&parts[k].found, between, within)) near[i] = KERNEL_NEAR_SURE;
            else if (is_possible(&parts[k].found, between, within)) near[i] = KERNEL_NEAR_POSSIBLE;
        }
    }
    differences_end(made);
    return KERNEL_OK;
}
