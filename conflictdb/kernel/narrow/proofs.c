/* Branch and bound over intervals of time.
 *
 * Apart: the gap along a fixed direction n, min(n.b) - max(n.a), is concave in time if all vertices move straight. Over
 * h seconds it is at least its chord, minus M h^2 / 8 for accelerations of at most M. This is a separating axis held
 * over time, as in continuous collision detection (Redon et al.).
 *
 * In contact: the signed separation of two rigid polygons in uniform motion is convex in time. It is at most its chord,
 * plus K h for velocities that differ by at most K (their spread).
 *
 * An interval for which neither is proven is halved, as in interval methods (Moore; Ratschek and Rokne; Snyder et al.),
 * with bounds from derivatives (Von Herzen et al.) instead of interval arithmetic. Short intervals are decided by the
 * distance and its rate, as in conservative advancement (Mirtich). Nothing is decided by sampling.
 *
 * References: R. E. Moore, "Interval Analysis" (1966). H. Ratschek, J. Rokne, "New Computer Methods for Global
 * Optimization" (1988). B. Von Herzen, A. H. Barr, H. R. Zatz, "Geometric collisions for time-dependent parametric
 * surfaces", SIGGRAPH 1990. J. M. Snyder, A. R. Woodbury, K. Fleischer, B. Currin, A. H. Barr, "Interval methods for
 * multi-point collisions between time-dependent curved surfaces", SIGGRAPH 1993. B. Mirtich, "Impulse-based dynamic
 * simulation of rigid body systems", thesis, University of California, Berkeley (1996). S. Redon, A. Kheddar, S.
 * Coquillart, "Fast continuous collision detection between rigid bodies", Computer Graphics Forum 21 (2002).
 */
#include "narrow/proofs.h"

#include "narrow/approach.h"

/* Clearances need not be exact above the margin plus this, metres: cheaper bounds suffice. Smaller: more intervals are
 * split; larger: more geodesic distances are computed. */
static const double NEAR_M = 100.0;
/* Intervals of a call inspected before the bounds of closest approaches are tried, which cost three times as much: for
 * pairs that pass at just the required separation. Smaller: other pairs cost more. */
enum { CHEAP_LOOKS = 16 };

/* Fractions of an interval outside which the pair is proven apart: throughout if u > v. */
typedef struct {
    double u, v;
    double clearance_m; /* in the middle */
    bool is_rounding;   /* the clearance exceeds the margin throughout, by less than the proofs need */
} Window;

/* Plane metres per second: the speed of b relative to a in the middle of a time, plus the spread; and the largest speed
 * of a vertex. */
typedef struct {
    double relative, fastest;
} Speeds;

static Speeds speeds_of(const Encounter *pair, double middle, Bounds bounds) {
    Vector a = mover_velocity(&pair->a, middle), b = mover_velocity(&pair->b, middle);
    return (Speeds){hypot(b.x - a.x, b.y - a.y) + bounds.spread, most(norm(a), norm(b)) + bounds.spread};
}

/* Narrow a window by the gap along an axis: proven apart while it exceeds `away`. */
static void narrow_along(Window *window, Vector axis, const Encounter *pair, double away) {
    double g0 = gap_along(axis, &pair->a0, &pair->b0) - away, g1 = gap_along(axis, &pair->a1, &pair->b1) - away;
    if (g0 > 0.0) window->u = g1 > 0.0 ? 2.0 : most(g0 / (g0 - g1), window->u);
    else if (g1 > 0.0) window->v = least(g0 / (g0 - g1), window->v);
}

/* Whether a pair that is apart in the middle of a time is proven apart throughout, by lower bounds on its distance. */
static bool stays_beyond(Encounter *pair, double start, double end, double wanted_m) {
    double first = approach_distance(pair, start), last = approach_distance(pair, end);
    return approach_during(pair, start, end, first, last, wanted_m + KERNEL_TOUCH_M).bound > wanted_m + KERNEL_TOUCH_M;
}

static Window window_of(Encounter *pair, double start, double end, double margin_m) {
    double middle = 0.5 * (start + end), h = end - start, wanted_m = pair->separation_m + margin_m;
    Window window = {.u = 0.0, .v = 1.0};
    pair->work->windows++;
    Vector first = encounter_plane_distance(pair, start).axis, last = encounter_plane_distance(pair, end).axis;
    Extent extent = encounter_extent(pair, start, end), a = extent_none(), b = extent_none();
    window.clearance_m = encounter_clearance_m(pair, middle, most(margin_m, -pair->separation_m) + NEAR_M);
    const Polygon *of_a[] = {&pair->a0, &pair->a_now, &pair->a1}, *of_b[] = {&pair->b0, &pair->b_now, &pair->b1};
    for (int k = 0; k < 3; k++) extent_add(&a, of_a[k], pair->a.origin), extent_add(&b, of_b[k], pair->a.origin);
    extent_add(&extent, &pair->a_now, pair->a.origin), extent_add(&extent, &pair->b_now, pair->a.origin);
    double largest = plane_largest_scale(pair->plane, &extent), smallest = plane_smallest_scale(pair->plane, &extent);
    /* A depth in plane metres is smallest at the smallest scale. The required separation is largest at the largest
     * scale among places within reach of each other. */
    double wanted = wanted_m * smallest;
    if (wanted_m >= 0.0) {
        Extent near = extent_within_reach(pair->plane, &a, &b, plane_span_m(pair->plane, wanted_m, largest));
        wanted = plane_span_m(pair->plane, wanted_m, plane_largest_scale(pair->plane, &near));
    }
    Bounds bounds = encounter_relative_bounds(pair, start, end);
    double away = bounds.acceleration * h * h / 8.0 + wanted + KERNEL_TOUCH_M * largest;
    Vector from, to, now = polygon_distance(&pair->a_now, &pair->b_now, &from, &to).axis;
    narrow_along(&window, first, pair, away);
    narrow_along(&window, now, pair, away);
    narrow_along(&window, last, pair, away);
    if (wanted_m > 0.0) {
        /* At the largest scale the separation is overestimated. Short intervals are decided by the distance on the
         * earth and its largest rate. The distance of overlapping polygons is 0. */
        double distance_m = most(window.clearance_m + pair->separation_m, 0.0);
        Speeds speeds = speeds_of(pair, middle, bounds);
        double rate = speeds.relative + plane_drift(pair->plane, distance_m, largest, speeds.fastest);
        double changes_m = 0.5 * rate * h / smallest, excess_m = window.clearance_m - margin_m;
        if (excess_m > changes_m + KERNEL_TOUCH_M) window.u = 2.0;
        window.is_rounding = excess_m > changes_m && excess_m + changes_m <= KERNEL_TOUCH_M;
    }
    return window;
}

/* Store an undecided interval, in place of one inspected before. */
static void keep(Intervals *intervals, int64_t *kept, double start, double end, Reason reason) {
    intervals->items[(*kept)++] = (Interval){start, end, 0.5 * (start + end), reason};
}

/* Append both halves of an interval to the end of the list; false if the list or the work budget is exhausted. */
static bool split(const Encounter *pair, Intervals *intervals, double start, double end) {
    double middle = 0.5 * (start + end);
    if (intervals->count + 2 > intervals->most || pair->looks_left <= 0 || pair->parts_left < 0) return false;
    intervals->items[intervals->count++] = (Interval){start, middle, 0.0, BORDERLINE};
    intervals->items[intervals->count++] = (Interval){middle, end, 0.0, BORDERLINE};
    return true;
}

/* Replace a list that is too full to be split by its hull: it may contain more time, never less. */
static void make_room(Intervals *intervals) {
    if (4 * intervals->count <= intervals->most) return;
    Interval hull = {INFINITY, -INFINITY, 0.0, BORDERLINE};
    for (int64_t i = 0; i < intervals->count; i++) {
        hull.start = least(hull.start, intervals->items[i].start);
        hull.end = most(hull.end, intervals->items[i].end);
    }
    intervals->items[0] = hull, intervals->count = 1;
}

void undecided_separation(Encounter *pair, Intervals *intervals, double margin_m) {
    REQUIRE(intervals->most > 0);
    make_room(intervals);
    int64_t kept = 0;
    for (int64_t next = 0; next < intervals->count; next++) {
        double start = intervals->items[next].start, end = intervals->items[next].end, h = end - start;
        /* Prove the pair apart outside a window of the interval; drop the interval if it is empty. */
        Window window = window_of(pair, start, end, margin_m);
        pair->looks_left--;
        if (window.u > window.v) continue;
        /* Try the sharper, slower bounds on distances. */
        bool is_near = window.clearance_m <= margin_m;
        double wanted_m = pair->separation_m + margin_m;
        if (!is_near && wanted_m > 0.0 && next >= CHEAP_LOOKS && stays_beyond(pair, start, end, wanted_m)) continue;
        /* Near in the middle: no proof exists. Keep the interval. */
        if (is_near) {
            keep(intervals, &kept, start, end, window.clearance_m <= KERNEL_TOUCH_M ? IN_CONTACT : NEARBY);
            continue;
        }
        /* Halve the window; keep it if halves are not decided, it is too short or the budget is exhausted. */
        if (window.is_rounding || h <= SHORTEST_INTERVAL_S ||
            !split(pair, intervals, start + window.u * h, start + window.v * h))
            keep(intervals, &kept, start, end, BORDERLINE);
    }
    intervals->count = kept;
}

void undecided_separation_in(Encounter *pair, Intervals *intervals, double start, double end, double margin_m) {
    REQUIRE(start <= end && intervals->most > 0);
    intervals->items[0] = (Interval){start, end, 0.0, BORDERLINE}, intervals->count = 1;
    undecided_separation(pair, intervals, margin_m);
}

/* Upper bound on the clearance during an interval, plane metres (with a separation, metres on the earth); infinite if the
 * pair is apart in the middle. */
static double clearance_upper_bound(Encounter *pair, double start, double end) {
    double middle = 0.5 * (start + end), h = end - start, clearance_m = encounter_clearance_m(pair, middle, NEAR_M);
    if (clearance_m > KERNEL_TOUCH_M) return INFINITY;
    Bounds bounds = encounter_relative_bounds(pair, start, end);
    Speeds speeds = speeds_of(pair, middle, bounds);
    if (pair->separation_m > 0.0) {
        Extent extent = encounter_extent(pair, start, end);
        double largest = plane_largest_scale(pair->plane, &extent);
        double rate = speeds.relative + plane_drift(pair->plane, pair->separation_m, largest, speeds.fastest);
        /* The scale is at least 1: a length in plane metres bounds the same length in metres on the earth. */
        return clearance_m + encounter_distance_error_m(pair, pair->separation_m) + 0.5 * rate * h;
    }
    double by_rate = encounter_plane_distance(pair, middle).gap + 0.5 * speeds.relative * h;
    if (by_rate < 0.0) return by_rate;
    double by_ends = most(encounter_plane_distance(pair, start).gap, encounter_plane_distance(pair, end).gap);
    return least(by_rate, by_ends + bounds.spread * h);
}

void undecided_contact(Encounter *pair, Intervals *intervals, double start, double end) {
    REQUIRE(start <= end && intervals->most > 0);
    int64_t kept = 0;
    intervals->items[0] = (Interval){start, end, 0.0, BORDERLINE}, intervals->count = 1;
    for (int64_t next = 0; next < intervals->count; next++) {
        double from = intervals->items[next].start, to = intervals->items[next].end;
        double upper = clearance_upper_bound(pair, from, to);
        pair->looks_left--;
        if (upper < 0.0) continue;
        if (upper == INFINITY) keep(intervals, &kept, from, to, NEARBY);
        else if (to - from <= SHORTEST_INTERVAL_S || !split(pair, intervals, from, to))
            keep(intervals, &kept, from, to, BORDERLINE);
    }
    intervals->count = kept;
}
