/* Directions that prove pairs apart, for somebody who checks them without this library (docs/reference/proof.md).
 *
 * Between two instants h seconds apart, the gap of a pair along a fixed direction is at least its chord, minus M h^2 / 8,
 * M a bound on how much paths of b bend away from those of a along it (planes/bend.h). So the gaps at both instants prove
 * the pair apart in between. With a required separation, each vertex reaches farther by its half of it (plane.h).
 *
 * A time is first tried with one direction: across the motion, or along the line of nearest points, with as few digits as
 * suffice. Where none does, it is halved. Times at whose ends the pair is not clearly apart are cut there.
 */
#include <stdlib.h>

#include "planes/bend.h"
#include "scene/border.h"

/* Gaps must exceed this, metres on the earth: twice what a checker asks for, whose numbers are rounded differently. */
static const double CLEAR_M = 2e-6;
/* Shorter times are not divided, seconds. Smaller: more steps next to contacts. */
static const double SHORTEST_S = 1e-6;
/* Next to a contact this time need not be proven, seconds: a tenth of what a checker allows. Smaller: more steps. */
static const double NEAR_CONTACT_S = 1e-3;
/* Most times of a pair that are inspected. Smaller: pairs that stay near each other for long are not proven. */
enum { MOST_LOOKS = 4096, DEEPEST = 96 };
/* Steps ahead whose directions may replace those of earlier ones. More: fewer steps, more work. */
enum { AHEAD = 8 };
/* Parts of a radian to which an angle is rounded, one after the other; 0: not at all. */
static const double DIGITS[] = {1e2, 1e4, 1e7, 0.0};
enum { ALL_DIGITS = sizeof DIGITS / sizeof *DIGITS };

/* The gap of a pair at an instant beyond what is required, plane metres, and its direction. */
typedef struct {
    double t, gap;
    Vector axis;
} Look;

typedef struct {
    KernelDirection *items;
    int64_t count, room, pair;
    bool is_full;
} List;

typedef struct {
    Encounter *pair;
    List *list;
    int64_t looks_left;
    double first_s, last_s; /* of the polygons a0, b0 and a1, b1 of the pair */
} Finder;

static void add(List *list, double until_s, double angle) {
    KernelDirection *last = list->count > 0 ? list->items + list->count - 1 : NULL;
    if (last && last->pair == list->pair && isnan(last->angle) && isnan(angle)) {
        last->until_s = until_s;
        return;
    }
    if (list->count == list->room) {
        int64_t room = list->room > 0 ? 2 * list->room : 1024;
        KernelDirection *items = realloc(list->items, (size_t)room * sizeof *items);
        if (!items) {
            list->is_full = true;
            return;
        }
        list->items = items, list->room = room;
    }
    list->items[list->count++] = (KernelDirection){list->pair, until_s, angle};
}

/* The smallest projection of a polygon onto a unit vector, its halves of the separation subtracted. */
static double least_with_half(const Encounter *pair, Vector axis, const Polygon *polygon) {
    double least = INFINITY;
    if (pair->separation_m == 0.0) return least_along(axis.x, axis.y, polygon);
    for (int64_t i = 0; i < polygon->count; i++) {
        Vector place = {polygon->x[i] + pair->a.origin.x, polygon->y[i] + pair->a.origin.y};
        double half = plane_half_m(pair->plane, pair->separation_m, place, false);
        half = plane_half_along(pair->plane, half, place, axis, false);
        double along = axis.x * polygon->x[i] + axis.y * polygon->y[i] - half;
        least = along < least ? along : least;
    }
    return least;
}

static double gap_with_halves(const Encounter *pair, Vector axis, const Polygon *a, const Polygon *b) {
    Vector back = {-axis.x, -axis.y};
    return least_with_half(pair, axis, b) + least_with_half(pair, back, a);
}

/* How far the halves of a vertex may change per plane metre that it leaves its chord by. */
static double half_slope(const Encounter *pair, double largest_scale) {
    double sine = sin(0.5 * pair->separation_m / pair->plane->radius_m);
    if (pair->plane->projection == KERNEL_GNOMONIC) return 3.5 * sine;
    sine *= largest_scale * 1.01;
    return sine * (1.0 + 0.63 * sine * sine);
}

static Look look_at(Finder *finder, double t) {
    Encounter *pair = finder->pair;
    Extent extent = extent_none();
    Gap nearest = encounter_plane_distance(pair, t);
    extent_add(&extent, &pair->a_now, pair->a.origin), extent_add(&extent, &pair->b_now, pair->a.origin);
    double gap = nearest.gap;
    if (pair->separation_m > 0.0 && gap > 0.0) gap = gap_with_halves(pair, nearest.axis, &pair->a_now, &pair->b_now);
    return (Look){t, gap - CLEAR_M * plane_largest_scale(pair->plane, &extent), nearest.axis};
}

static void put_ends(Finder *finder, double t0, double t1) {
    Encounter *pair = finder->pair;
    if (finder->first_s != t0) encounter_put(pair, t0, &pair->a0, &pair->b0);
    if (finder->last_s != t1) encounter_put(pair, t1, &pair->a1, &pair->b1);
    finder->first_s = t0, finder->last_s = t1;
}

/* Whether a direction proves the pair apart during a time whose ends are a0, b0 and a1, b1. */
static bool is_proven(const Encounter *pair, double t0, double t1, double angle) {
    Vector axis = {cos(angle), sin(angle)}, north = {0.0, 1.0};
    double first = gap_with_halves(pair, axis, &pair->a0, &pair->b0), h = t1 - t0;
    if (!(first > 0.0)) return false;
    double gap = least(first, gap_with_halves(pair, axis, &pair->a1, &pair->b1));
    if (!(gap > 0.0)) return false;
    Extent extent = extent_none();
    extent_add(&extent, &pair->a0, pair->a.origin), extent_add(&extent, &pair->a1, pair->a.origin);
    extent_add(&extent, &pair->b0, pair->a.origin), extent_add(&extent, &pair->b1, pair->a.origin);
    double largest = plane_largest_scale(pair->plane, &extent);
    Range a = mover_bend(&pair->a, axis, t0, t1), b = mover_bend(&pair->b, axis, t0, t1);
    double bend = most(b.high - a.low, 0.0);
    if (pair->separation_m > 0.0) {
        Range of_a = mover_bend(&pair->a, north, t0, t1), of_b = mover_bend(&pair->b, north, t0, t1);
        double away = most(most(of_a.high, -of_a.low), 0.0) + most(most(of_b.high, -of_b.low), 0.0);
        bend += half_slope(pair, largest) * away;
    }
    return gap > (1.0 + 1e-9) * bend * h * h / 8.0 + CLEAR_M * largest;
}

/* Try an axis with few digits, then with more; the angle that proves the time, or NaN. */
static double angle_of(const Encounter *pair, double t0, double t1, Vector axis) {
    double angle = atan2(axis.y, axis.x);
    if (!isfinite(angle)) return NAN;
    for (int k = 0; k < ALL_DIGITS; k++) {
        double rounded = DIGITS[k] > 0.0 ? nearbyint(angle * DIGITS[k]) / DIGITS[k] : angle;
        if (is_proven(pair, t0, t1, rounded)) return rounded;
        /* More digits help only if all of them do. */
        if (k == 0 && !is_proven(pair, t0, t1, angle)) return NAN;
    }
    return NAN;
}

static Vector middle_between(const Polygon *a, const Polygon *b) {
    Vector way = {0.0, 0.0};
    for (int64_t i = 0; i < b->count; i++) way.x += b->x[i] / (double)b->count, way.y += b->y[i] / (double)b->count;
    for (int64_t i = 0; i < a->count; i++) way.x -= a->x[i] / (double)a->count, way.y -= a->y[i] / (double)a->count;
    return way;
}

/* The direction across the relative motion in which b lies; along it the gap hardly changes. */
static Vector across_motion(const Encounter *pair) {
    Vector from = middle_between(&pair->a0, &pair->b0), to = middle_between(&pair->a1, &pair->b1);
    Vector across = {-(to.y - from.y), to.x - from.x};
    double length = norm(across), side = across.x * (from.x + to.x) + across.y * (from.y + to.y);
    if (!(length > 0.0)) return (Vector){NAN, NAN};
    if (side < 0.0) length = -length;
    return (Vector){across.x / length, across.y / length};
}

/* One direction for a time, or NaN. */
static double one_angle(const Encounter *pair, Look first, Look last) {
    Look nearer = first.gap < last.gap ? first : last, farther = first.gap < last.gap ? last : first;
    double found = angle_of(pair, first.t, last.t, nearer.axis);
    if (isnan(found)) found = angle_of(pair, first.t, last.t, across_motion(pair));
    if (isnan(found)) found = angle_of(pair, first.t, last.t, farther.axis);
    return found;
}

/* About the last instant, on the way from one at which a pair is clearly apart to one at which it is not, at which it is. */
static Look last_clear(Finder *finder, Look clear, Look near) {
    if (fabs(near.t - clear.t) > 2.0 * NEAR_CONTACT_S) {
        Look now = look_at(finder, near.t + copysign(NEAR_CONTACT_S, clear.t - near.t));
        if (now.gap > 0.0) return now;
        near = now;
    }
    while (fabs(near.t - clear.t) > SHORTEST_S && finder->looks_left-- > 0) {
        double middle = 0.5 * (clear.t + near.t);
        if (middle == clear.t || middle == near.t) break;
        Look now = look_at(finder, middle);
        if (now.gap > 0.0) clear = now;
        else near = now;
    }
    return clear;
}

/* Add the steps of a time at both of whose ends the pair is clearly apart. */
static void cover(Finder *finder, Look low, Look high) {
    struct {
        Look first, last;
    } stack[DEEPEST + 2], part;
    int top = 0;
    stack[top].first = low, stack[top++].last = high;
    while (top > 0) {
        part = stack[--top];
        double t0 = part.first.t, t1 = part.last.t, middle = 0.5 * (t0 + t1);
        if (!(part.first.gap > 0.0) || !(part.last.gap > 0.0)) {
            /* In contact at an end: the rest of the time is not proven. */
            Look clear = part.first.gap > 0.0 ? part.first : part.last;
            Look near = part.first.gap > 0.0 ? part.last : part.first;
            if (!(clear.gap > 0.0)) {
                add(finder->list, t1, NAN);
                continue;
            }
            Look cut = last_clear(finder, clear, near);
            if (cut.t == clear.t || top + 1 > DEEPEST) {
                add(finder->list, t1, NAN);
            } else if (clear.t < near.t) {
                stack[top].first = near, stack[top].first.t = cut.t, stack[top++].last = near;
                stack[top].first = clear, stack[top++].last = cut;
            } else {
                add(finder->list, cut.t, NAN);
                stack[top].first = cut, stack[top++].last = clear;
            }
            continue;
        }
        put_ends(finder, t0, t1);
        double angle = one_angle(finder->pair, part.first, part.last);
        if (!isnan(angle) || t1 - t0 <= SHORTEST_S || middle == t0 || middle == t1 || top + 2 > DEEPEST ||
            finder->looks_left-- <= 0) {
            add(finder->list, t1, angle);
            continue;
        }
        Look now = look_at(finder, middle);
        stack[top].first = now, stack[top++].last = part.last;
        stack[top].first = part.first, stack[top++].last = now;
    }
}

/* Let each direction serve as long as it may: steps that others make superfluous go. */
static void join(Finder *finder, int64_t begin, double low) {
    List *list = finder->list;
    int64_t end = list->count, kept = begin;
    double from = low;
    for (int64_t k = begin; k < end;) {
        KernelDirection best = list->items[k];
        int64_t next = k + 1;
        for (int64_t n = k; n < end && n < k + AHEAD && !isnan(list->items[n].angle); n++) {
            double angle = list->items[n].angle;
            int64_t reached = k;
            for (int64_t j = next; j < end && !isnan(list->items[j].angle); j++) {
                put_ends(finder, from, list->items[j].until_s);
                if (!is_proven(finder->pair, from, list->items[j].until_s, angle)) break;
                reached = j;
            }
            if (reached >= next) best = (KernelDirection){list->pair, list->items[reached].until_s, angle}, next = reached + 1;
        }
        list->items[kept++] = best;
        from = best.until_s, k = next;
    }
    list->count = kept;
}

static void find_directions(Finder *finder, double low, double high) {
    Encounter *pair = finder->pair;
    int64_t begin = finder->list->count;
    finder->looks_left = MOST_LOOKS, finder->first_s = finder->last_s = NAN;
    mover_focus(&pair->a, low, high), mover_focus(&pair->b, low, high);
    /* Most pairs pass each other: across their motion no distance need be found. */
    if (high > low) {
        put_ends(finder, low, high);
        double angle = angle_of(pair, low, high, across_motion(pair));
        if (!isnan(angle)) {
            add(finder->list, high, angle);
            return;
        }
    }
    Look first = look_at(finder, low), last = high > low ? look_at(finder, high) : first;
    cover(finder, first, last);
    if (!finder->list->is_full && finder->list->count - begin > 1) join(finder, begin, low);
}

KernelStatus kernel_directions(const KernelScene *scene, const KernelPairs *pairs, double separation_m,
                               KernelDirection **directions, int64_t *count, KernelWork *work) {
    if (!directions || !count || !work) return KERNEL_NULL;
    double *memory;
    Encounter pair = {.separation_m = separation_m, .work = work};
    *directions = NULL, *count = 0, *work = (KernelWork){0};
    KernelStatus status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    List list = {.items = NULL};
    Finder finder = {.pair = &pair, .list = &list};
    for (int64_t i = 0; i < pairs->count && !list.is_full; i++) {
        double low = pairs->low_s[i], high = pairs->high_s[i];
        list.pair = i;
        bool is_valid = low <= high && border_meet(scene, pairs, i, &pair);
        if (is_valid && separation_m > 0.0) {
            Extent extent = encounter_extent(&pair, low, high);
            is_valid = !plane_half_is_long(pair.plane, separation_m, plane_largest_scale(pair.plane, &extent));
        }
        if (is_valid) find_directions(&finder, low, high);
        else add(&list, high, NAN);
    }
    free(memory);
    if (list.is_full) {
        free(list.items);
        return KERNEL_NO_MEMORY;
    }
    *directions = list.items, *count = list.count;
    return KERNEL_OK;
}
