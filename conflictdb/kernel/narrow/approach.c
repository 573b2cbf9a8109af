/* Closest point of approach (CPA) of groups of pairs of pieces: how close two objects come, when and where.
 *
 * Branch and bound over time, for all pairs of a group together:
 *
 * 1. Bound the distance of each pair from below, during its whole time.
 * 2. Take the time with the smallest bound. Halve it and bound both halves (`search_group`).
 * 3. Stop when no bound is smaller than the smallest distance seen, or the required accuracy is reached. One close pair
 *    thus saves the work of the others.
 * 4. Refine the instant (`group_passage`), or prove which touch is the first (`group_touch`).
 *
 * The reported error is the difference between the smallest distance seen and the smallest bound. Nothing is decided by
 * sampling. Of equally close instants the earliest is reported.
 */
#include "narrow/approach.h"

#include <stdlib.h>

#include "scene/border.h"
#include "narrow/meeting.h"

/* Accuracy of distances, metres, unless a coarser one is enough or the work budget is exhausted. Smaller: more work. */
static const double APPROACH_M = 2.5e-4;
/* With a coarse accuracy, the distance at an instant is computed to this fraction of it. Smaller: more work, for digits
 * below the accuracy. */
static const double WAY_SHARE = 0.01;
/* Distances that differ by less than this, metres, are equal: ten times the rounding error. Smaller: rounding decides
 * which instant is reported. */
static const double TIE_M = 1e-7;
/* Times are not halved below a microsecond, the resolution of a timestamp; instants are bracketed to a hundredth of it.
 */
static const double SHORTEST_S = 1e-6, BRACKET_S = 1e-8;
/* Budgets. Halvings of a group's times: when exhausted, the distance is reported with the bound reached. Times of a
 * pair inspected for its first touch. */
enum { MAX_HALVED = 4096, MAX_LOOKS = 4096 };
/* Steps of the search for an instant: 48 bisections reduce a month to a microsecond. */
enum { MAX_STEPS = 48 };
static const double GOLDEN = 0x1.3c6ef372fe95p-1;

/* A part of a pair's time: a lower bound on the distance during it, and the distances at its ends and in the middle,
 * metres. */
typedef struct {
    double bound, start, end, first, middle, last;
    int64_t pair;
    bool is_seen; /* false: only the bound is known */
} Part;

/* Results for a pair: the smallest distance seen and its instant; half the length of the time around it that is not
 * resolved further; and the smallest bound of its finished parts. */
typedef struct {
    double least, at, half, floor;
} Seen;

/* A connecting line of two movers at an instant: the pair, the instant, its length on the earth, and its ends. */
typedef struct {
    int64_t pair;
    double at, length;
    Vector from, to;
} Way;

/* State of the search of a group: the heap of parts, ordered by bound, and the results of each pair. */
typedef struct {
    const Scene *scene;
    const KernelPairs *pairs;
    Encounter pair;
    int64_t met; /* the pair that the encounter is set up for, or -1 */
    int64_t first_pair, last_pair;
    Part *heap;
    int64_t parts;
    Seen *seen; /* by pair minus first_pair */
    double limit, accuracy, least, floor;
    Way way; /* the shortest one inspected at coarse accuracy */
} Search;

static void push(Search *search, Part part) {
    int64_t i = search->parts++;
    for (int64_t parent = (i - 1) / 2; i > 0 && part.bound < search->heap[parent].bound; parent = (i - 1) / 2) {
        search->heap[i] = search->heap[parent];
        i = parent;
    }
    search->heap[i] = part;
}

static Part pop(Search *search) {
    Part top = search->heap[0], part = search->heap[--search->parts];
    int64_t i = 0;
    for (int64_t child = 1; child < search->parts; child = 2 * i + 1) {
        if (child + 1 < search->parts && search->heap[child + 1].bound < search->heap[child].bound) child++;
        if (part.bound <= search->heap[child].bound) break;
        search->heap[i] = search->heap[child];
        i = child;
    }
    search->heap[i] = part;
    return top;
}

/* Set up the encounter for a pair; false if the pair is invalid. */
static bool meet(Search *search, int64_t i) {
    if (search->met == i) return true;
    search->met = -1;
    if (!border_meet(search->scene, search->pairs, i, &search->pair)) return false;
    search->met = i;
    return true;
}

static double distance_at(Search *search, int64_t i, double t) {
    meet(search, i);
    return approach_distance(&search->pair, t);
}

static void see(Search *search, int64_t i, double t, double distance, double half) {
    Seen *seen = search->seen + (i - search->first_pair);
    if (distance < seen->least || (distance == seen->least && t < seen->at)) {
        seen->least = distance, seen->at = t, seen->half = half;
    }
    search->least = least(search->least, distance);
}

/* Distances above this need not be known. */
static double limit_of(const Search *search) { return least(search->least, search->limit); }

/* Whether the required accuracy is coarser than APPROACH_M. */
static bool is_coarse(const Search *search) { return search->accuracy > APPROACH_M; }

static void finish(Search *search, Part part) {
    Seen *seen = search->seen + (part.pair - search->first_pair);
    seen->floor = least(seen->floor, part.bound);
    search->floor = least(search->floor, part.bound);
}

/* Bound the part [start, end] of a pair, given the distances at its ends, and push it. */
static void bound_part(Search *search, int64_t i, double start, double end, double first, double last) {
    meet(search, i);
    During during = approach_during(&search->pair, start, end, first, last, limit_of(search) - search->accuracy);
    see(search, i, 0.5 * (start + end), during.middle, 0.5 * (end - start));
    push(search, (Part){during.bound, start, end, first, during.middle, last, i, true});
}

/* Lower bound on the distance on the earth between places at least `gap` plane metres apart, also around the other side
 * of the earth. */
static double least_of_gap(const Encounter *pair, double gap) {
    Extent extent = extent_none();
    extent_add(&extent, &pair->a_now, pair->a.origin), extent_add(&extent, &pair->b_now, pair->a.origin);
    double around = plane_turn_m(pair->plane) - (extent.east - extent.west), nearer = least(gap, around);
    return nearer > 0.0 ? plane_least_m(pair->plane, nearer, plane_largest_scale(pair->plane, &extent)) : 0.0;
}

/* The shortest connecting line at an instant, to WAY_SHARE of the accuracy. Mostly the nearest points in the plane
 * suffice, which take far less work. */
static Way way_at(Search *search, int64_t i, double t) {
    Way way = {.pair = i, .at = t};
    meet(search, i);
    Encounter *pair = &search->pair;
    pair->work->evaluations++;
    encounter_place(pair, t);
    double gap = polygon_distance(&pair->a_now, &pair->b_now, &way.from, &way.to).gap;
    if (!(gap > 0.0)) return way;
    way.length = plane_way_m(pair->plane, way.from, way.to, pair->a.origin);
    if (way.length - least_of_gap(pair, gap) <= WAY_SHARE * search->accuracy) return way;
    Vector origin = pair->a.origin;
    int64_t *left = &pair->parts_left;
    way.length = plane_metres(pair->plane, &pair->a_now, &pair->b_now, origin, gap, way.from, way.to, left);
    plane_nearest(pair->plane, &pair->a_now, &pair->b_now, origin, &way.from, &way.to, left);
    return way;
}

/* Whether a look at the middle of a pair's time is enough. Only for a coarse accuracy; it avoids the distances at both
 * ends. */
static bool is_known_by_middle(Search *search, Part *part) {
    if (!is_coarse(search) || !(part->end > part->start)) return false;
    Way way = way_at(search, part->pair, 0.5 * (part->start + part->end));
    if (way.length < search->way.length) search->way = way;
    see(search, way.pair, way.at, way.length, 0.5 * (part->end - part->start));
    if (part->bound >= limit_of(search) - search->accuracy) return true;
    During during = approach_during(&search->pair, part->start, part->end, 0.0, 0.0, limit_of(search) - search->accuracy);
    see(search, part->pair, 0.5 * (part->start + part->end), during.middle, 0.5 * (part->end - part->start));
    part->bound = most(part->bound, during.bound);
    return part->bound >= limit_of(search) - search->accuracy;
}

static void look_at_pair(Search *search, Part part) {
    if (is_known_by_middle(search, &part)) {
        finish(search, part);
        return;
    }
    double half = 0.5 * (part.end - part.start), first = distance_at(search, part.pair, part.start);
    see(search, part.pair, part.start, first, half);
    if (!(part.end > part.start)) {
        part.bound = first;
        finish(search, part);
        return;
    }
    double last = distance_at(search, part.pair, part.end);
    see(search, part.pair, part.end, last, half);
    bound_part(search, part.pair, part.start, part.end, first, last);
}

/* Halve times until no bound is below the smallest distance, or the pair touches. */
static void search_group(Search *search) {
    int halved = 0;
    while (search->parts > 0 && search->least > KERNEL_TOUCH_M) {
        /* No remaining part can be closer. */
        if (search->heap[0].bound > limit_of(search) + TIE_M) return;
        Part part = pop(search);
        /* First visit: compute distances at the ends and in the middle. */
        if (!part.is_seen && !(part.bound >= search->least - search->accuracy)) {
            look_at_pair(search, part);
            continue;
        }
        /* Accurate enough, as short as a timestamp, or out of budget. */
        bool is_done = part.bound >= limit_of(search) - search->accuracy || part.end - part.start <= SHORTEST_S;
        if (is_done || halved >= MAX_HALVED) {
            finish(search, part);
            continue;
        }
        /* Bound both halves. */
        double middle = 0.5 * (part.start + part.end);
        bound_part(search, part.pair, part.start, middle, part.first, part.middle);
        bound_part(search, part.pair, middle, part.end, part.middle, part.last);
        halved++;
    }
}

/* Minimise the distance around the smallest one seen of a pair, by golden section search (J. Kiefer, Proc. AMS 4
 * (1953), doi:10.1090/S0002-9939-1953-0055639-3). */
static void polish(Search *search, int64_t i) {
    const Seen *seen = search->seen + (i - search->first_pair);
    double low = most(seen->at - seen->half, search->pairs->low_s[i]);
    double high = least(seen->at + seen->half, search->pairs->high_s[i]);
    double left = high - GOLDEN * (high - low), right = low + GOLDEN * (high - low);
    double at_left = distance_at(search, i, left), at_right = distance_at(search, i, right);
    for (int step = 0; step < MAX_STEPS && high - low > SHORTEST_S; step++) {
        if (at_left <= at_right) {
            high = right, right = left, at_right = at_left, left = high - GOLDEN * (high - low);
            at_left = distance_at(search, i, left);
        } else {
            low = left, left = right, at_left = at_right, right = low + GOLDEN * (high - low);
            at_right = distance_at(search, i, right);
        }
    }
    see(search, i, left, at_left, 0.0);
    see(search, i, right, at_right, 0.0);
}

/* The first instant at which the distance is at most a level, by bisection: above it at `outside`, at most it at
 * `inside`. */
static double first_below(Search *search, int64_t i, double outside, double inside, double level) {
    for (int step = 0; step < MAX_STEPS && inside - outside > BRACKET_S; step++) {
        double middle = 0.5 * (outside + inside);
        if (distance_at(search, i, middle) <= level) inside = middle;
        else outside = middle;
    }
    return inside;
}

/* Find the first touch of a pair during [low, high], in *at; false if there is none. The pair is proven apart before
 * it, except for times of a microsecond, and if the work budget is exhausted. */
static bool first_touch(Search *search, int64_t i, double low, double high, double *at) {
    struct {
        double start, end, first, last;
    } stack[2 * MAX_STEPS], part;
    int top = 0, looks = 0;
    stack[top].start = low, stack[top].end = high;
    stack[top].first = distance_at(search, i, low), stack[top].last = distance_at(search, i, high), top++;
    while (top > 0) {
        part = stack[--top];
        if (part.first <= KERNEL_TOUCH_M) {
            *at = part.start;
            return true;
        }
        During during = approach_during(&search->pair, part.start, part.end, part.first, part.last, INFINITY);
        if (during.bound > KERNEL_TOUCH_M) continue;
        bool is_short = part.end - part.start <= SHORTEST_S || ++looks > MAX_LOOKS || top + 2 > 2 * MAX_STEPS;
        double middle = 0.5 * (part.start + part.end);
        if (!is_short) {
            if (during.middle > KERNEL_TOUCH_M) {
                stack[top].start = middle, stack[top].end = part.end;
                stack[top].first = during.middle, stack[top].last = part.last, top++;
            }
            stack[top].start = part.start, stack[top].end = middle;
            stack[top].first = part.first, stack[top].last = during.middle, top++;
        } else if (least(during.middle, part.last) <= KERNEL_TOUCH_M) {
            double inside = during.middle <= KERNEL_TOUCH_M ? middle : part.end;
            *at = first_below(search, i, part.start, inside, KERNEL_TOUCH_M);
            return true;
        }
    }
    return false;
}

/* The instant of a group's closest approach. */
typedef struct {
    int64_t pair, at_us;
    double at;
} Moment;

/* us plus s seconds, clamped to 64 bits. */
static int64_t later_us(int64_t us, double s) {
    int64_t more = llrint(least(most(s * 1e6, -0x1p61), 0x1p61));
    if (more > 0 ? us > INT64_MAX - more : us < INT64_MIN - more) return more > 0 ? INT64_MAX : INT64_MIN;
    return us + more;
}

static void take_earlier(const Search *search, Moment *moment, int64_t i, double at) {
    int64_t at_us = later_us(search->pairs->zero_us[i], at);
    if (moment->pair < 0 || at_us < moment->at_us) *moment = (Moment){i, at_us, at};
}

/* The first touch of a group that is known to touch. */
static Moment group_touch(Search *search) {
    Moment known = {-1, 0, 0.0}, moment = known;
    for (int64_t i = search->first_pair; i < search->last_pair; i++) {
        const Seen *seen = search->seen + (i - search->first_pair);
        if (seen->least <= KERNEL_TOUCH_M) take_earlier(search, &known, i, seen->at);
    }
    for (int64_t i = search->first_pair; i < search->last_pair; i++) {
        const Moment *until = moment.pair < 0 ? &known : &moment;
        double low = search->pairs->low_s[i], at;
        /* In double arithmetic: the instants of areas without end do not fit into 64 bits of microseconds. */
        double high = ((double)until->at_us - (double)search->pairs->zero_us[i]) / 1e6 + SHORTEST_S;
        high = least(i == until->pair ? until->at : high, search->pairs->high_s[i]);
        if (!(high >= low) || !meet(search, i) || approach_at_least(&search->pair, low, high) > KERNEL_TOUCH_M) continue;
        if (first_touch(search, i, low, high, &at)) take_earlier(search, &moment, i, at);
    }
    return moment.pair < 0 ? known : moment;
}

/* The earliest instant of a group's minimum; with a coarse accuracy, an instant of the smallest distance seen. */
static Moment group_passage(Search *search) {
    Moment moment = {-1, 0, 0.0};
    for (int64_t i = search->first_pair; i < search->last_pair; i++) {
        const Seen *seen = search->seen + (i - search->first_pair);
        bool is_near = seen->least <= limit_of(search) + search->accuracy && seen->half > 0.0;
        if (is_near && seen->least - seen->floor > (is_coarse(search) ? search->accuracy : TIE_M)) polish(search, i);
    }
    if (search->least > search->limit) return moment;
    for (int64_t i = search->first_pair; i < search->last_pair; i++) {
        const Seen *seen = search->seen + (i - search->first_pair);
        double low = search->pairs->low_s[i], level = search->least + TIE_M, at = seen->at;
        if (seen->least > level) continue;
        if (!is_coarse(search) && distance_at(search, i, low) > level) at = first_below(search, i, low, at, level);
        else if (!is_coarse(search)) at = low;
        take_earlier(search, &moment, i, at);
    }
    return moment;
}

/* Start the search with the pairs of a group; false if one of them is invalid. */
static bool begin_group(Search *search, int64_t first_pair, int64_t last_pair, double limit, double accuracy) {
    search->first_pair = first_pair, search->last_pair = last_pair, search->parts = 0;
    search->limit = limit, search->accuracy = most(accuracy, APPROACH_M), search->least = INFINITY, search->floor = INFINITY;
    search->way = (Way){.pair = -1, .length = INFINITY};
    for (int64_t i = first_pair; i < last_pair; i++) {
        double low = search->pairs->low_s[i], high = search->pairs->high_s[i];
        if (!(high >= low) || !meet(search, i)) return false;
        search->seen[i - first_pair] = (Seen){INFINITY, low, 0.0, INFINITY};
        /* With a coarse accuracy the first look is often enough for the whole group, so bounds are computed later. */
        double bound = is_coarse(search) ? 0.0 : approach_at_least(&search->pair, low, high);
        push(search, (Part){.bound = bound, .start = low, .end = high, .pair = i});
        if (!(search->heap[search->parts - 1].bound >= 0.0)) return false;
    }
    return true;
}

/* The answer for a group. */
typedef struct {
    Moment moment;
    double distance, error, a_deg[2], b_deg[2];
} Stated;

static Stated state_group(Search *search) {
    const KernelPlane *plane = &search->scene->plane;
    Stated stated = {{-1, 0, 0.0}, INFINITY, 0.0, {NAN, NAN}, {NAN, NAN}};
    bool touches = search->least <= KERNEL_TOUCH_M;
    stated.moment = touches ? group_touch(search) : group_passage(search);
    if (stated.moment.pair < 0) return stated;
    meet(search, stated.moment.pair);
    if (touches || search->least <= KERNEL_TOUCH_M) {
        stated.distance = 0.0;
        plane_degrees(plane, encounter_meeting(&search->pair, stated.moment.at), stated.a_deg);
        stated.b_deg[0] = stated.a_deg[0], stated.b_deg[1] = stated.a_deg[1];
        return stated;
    }
    stated.distance = search->least;
    stated.error = most(search->least - search->floor, 0.0) + KERNEL_TOUCH_M;
    if (search->least > plane_short_m(plane)) stated.error += plane_distance_error_m(plane, search->least);
    Encounter *pair = &search->pair;
    Vector origin = pair->a.origin;
    Way way = search->way;
    if (!(way.pair == stated.moment.pair && way.length == stated.distance)) {
        encounter_place(pair, stated.moment.at);
        plane_nearest(plane, &pair->a_now, &pair->b_now, origin, &way.from, &way.to, &pair->parts_left);
    }
    plane_degrees(plane, (Vector){way.from.x + origin.x, way.from.y + origin.y}, stated.a_deg);
    plane_degrees(plane, (Vector){way.to.x + origin.x, way.to.y + origin.y}, stated.b_deg);
    return stated;
}

static KernelStatus check_groups(const KernelPairs *pairs, const KernelGroups *groups, int64_t *largest) {
    *largest = 0;
    if (groups->count < 0) return KERNEL_BAD_COUNT;
    if (!groups->offset || (groups->count > 0 && (!groups->limit_m || !groups->accuracy_m))) return KERNEL_NULL;
    if (groups->offset[0] != 0) return KERNEL_BAD_OFFSET;
    for (int64_t g = 0; g < groups->count; g++) {
        if (groups->offset[g + 1] < groups->offset[g]) return KERNEL_BAD_OFFSET;
        int64_t size = groups->offset[g + 1] - groups->offset[g];
        *largest = size > *largest ? size : *largest;
    }
    return groups->offset[groups->count] == pairs->count ? KERNEL_OK : KERNEL_BAD_OFFSET;
}

KernelStatus kernel_approaches(const KernelScene *scene, const KernelPairs *pairs, const KernelGroups *groups, int64_t *pair,
                               double *at_s, double *distance_m, double *error_m, double *a_deg, double *b_deg,
                               KernelWork *work) {
    double *memory;
    int64_t largest;
    if (!scene || !pairs || !groups || !work) return KERNEL_NULL;
    if (groups->count > 0 && (!pair || !at_s || !distance_m || !error_m || !a_deg || !b_deg)) return KERNEL_NULL;
    *work = (KernelWork){0};
    Search search = {.scene = scene, .pairs = pairs, .pair = {.work = work}, .met = -1};
    KernelStatus status = border_begin(scene, pairs, &search.pair, &memory);
    if (status != KERNEL_OK) return status;
    status = check_groups(pairs, groups, &largest);
    if (status == KERNEL_OK) {
        /* Each halving adds one part. */
        search.heap = malloc(((size_t)largest + MAX_HALVED + 2) * sizeof *search.heap);
        search.seen = malloc(((size_t)largest + 1) * sizeof *search.seen);
        if (!search.heap || !search.seen) status = KERNEL_NO_MEMORY;
    }
    for (int64_t g = 0; status == KERNEL_OK && g < groups->count; g++) {
        const Stated unknown = {{-1, 0, 0.0}, NAN, NAN, {NAN, NAN}, {NAN, NAN}};
        Stated stated = unknown;
        search.pair.parts_left = PLANE_MAX_PARTS;
        if (begin_group(&search, groups->offset[g], groups->offset[g + 1], groups->limit_m[g], groups->accuracy_m[g])) {
            search_group(&search);
            for (int64_t k = 0; k < search.parts; k++) finish(&search, search.heap[k]);
            /* Without a limit, and no distance seen, the answer is unknown. */
            bool is_known = search.least < INFINITY || search.limit < INFINITY || search.first_pair == search.last_pair;
            if (is_known) stated = state_group(&search);
            if (search.pair.parts_left < 0) stated = unknown;
        }
        pair[g] = stated.moment.pair, at_s[g] = stated.moment.at;
        distance_m[g] = stated.distance, error_m[g] = stated.error;
        for (int k = 0; k < 2; k++) a_deg[2 * g + k] = stated.a_deg[k], b_deg[2 * g + k] = stated.b_deg[k];
    }
    free(search.heap), free(search.seen), free(memory);
    return status;
}
