#define _POSIX_C_SOURCE 200809L /* clock_gettime */
#include "narrow/encounter.h"

#include <time.h>

#include "geometry/runs.h"

double encounter_clock_s(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void encounter_set_closed_form(Encounter *pair, bool in_closed_form) {
    pair->in_closed_form = in_closed_form;
    if (in_closed_form == (pair->closed_form_since_s > 0.0)) return;
    double now = encounter_clock_s();
    if (!in_closed_form) pair->work->closed_form_s += now - pair->closed_form_since_s;
    pair->closed_form_since_s = in_closed_form ? now : 0.0;
}

void encounter_ask(Encounter *pair, double separation_m, double margin_m) {
    REQUIRE(separation_m >= 0.0 && margin_m >= 0.0);
    pair->separation_m = separation_m, pair->margin_m = most(margin_m, KERNEL_TOUCH_M);
    pair->deep_m = pair->margin_m;
    if (separation_m > 0.0) pair->deep_m = most(pair->deep_m, encounter_certainty_margin_m(pair));
}

void encounter_put(Encounter *pair, double t, Polygon *a, Polygon *b) {
    mover_place(&pair->a, t, a);
    mover_place(&pair->b, t, b);
}

void encounter_place(Encounter *pair, double t) {
    encounter_put(pair, t, &pair->a_now, &pair->b_now);
    if (!pair->a.body->is_convex) polygon_hull(&pair->a_now, &pair->spare);
    if (!pair->b.body->is_convex) polygon_hull(&pair->b_now, &pair->spare);
    runs_make(&pair->a_now, &pair->b_now);
}

Bounds encounter_bounds(const Encounter *pair, double t0, double t1) {
    REQUIRE(t0 <= t1);
    Bounds a = mover_bounds(&pair->a, t0, t1), b = mover_bounds(&pair->b, t0, t1);
    return (Bounds){a.acceleration + b.acceleration, a.spread + b.spread};
}

Bounds encounter_relative_bounds(const Encounter *pair, double t0, double t1) {
    Bounds bounds = encounter_bounds(pair, t0, t1);
    if (pair->a.body->motion == STANDS_STILL || pair->b.body->motion == STANDS_STILL) return bounds;
    Acceleration a = mover_acceleration(&pair->a, t0, t1), b = mover_acceleration(&pair->b, t0, t1);
    double relative = hypot(b.middle.x - a.middle.x, b.middle.y - a.middle.y) + a.variation + b.variation;
    if (!(relative < bounds.acceleration)) return bounds;
    /* The spread is that in the middle, plus the acceleration times half of the time. */
    return (Bounds){relative, bounds.spread - 0.5 * (t1 - t0) * (bounds.acceleration - relative)};
}

Extent encounter_extent(Encounter *pair, double start, double end) {
    Extent extent = extent_none();
    encounter_put(pair, start, &pair->a0, &pair->b0);
    encounter_put(pair, end, &pair->a1, &pair->b1);
    extent_add(&extent, &pair->a0, pair->a.origin), extent_add(&extent, &pair->a1, pair->a.origin);
    extent_add(&extent, &pair->b0, pair->a.origin), extent_add(&extent, &pair->b1, pair->a.origin);
    return extent;
}

Scales encounter_scales_within(const Encounter *pair, double reach) {
    Extent a = extent_none(), b = extent_none();
    extent_add(&a, &pair->a0, pair->a.origin), extent_add(&a, &pair->a1, pair->a.origin);
    extent_add(&b, &pair->b0, pair->a.origin), extent_add(&b, &pair->b1, pair->a.origin);
    Extent near = extent_within_reach(pair->plane, &a, &b, reach);
    return plane_scales(pair->plane, &near);
}

Gap encounter_gap(Encounter *pair, double t) {
    pair->work->evaluations++;
    encounter_place(pair, t);
    return polygon_separation(&pair->a_now, &pair->b_now);
}

Gap encounter_plane_distance(Encounter *pair, double t) {
    Vector from, to;
    pair->work->evaluations++;
    encounter_place(pair, t);
    return polygon_distance(&pair->a_now, &pair->b_now, &from, &to);
}

double encounter_clearance_m(Encounter *pair, double t, double within_m) {
    pair->work->evaluations++;
    encounter_place(pair, t);
    double known_m = most(pair->separation_m + within_m, 0.0);
    double distance_m =
        plane_distance_within_m(pair->plane, &pair->a_now, &pair->b_now, pair->a.origin, known_m, &pair->parts_left);
    return distance_m - pair->separation_m;
}

double encounter_distance_error_m(const Encounter *pair, double distance_m) {
    return distance_m > plane_short_m(pair->plane) ? plane_distance_error_m(pair->plane, distance_m) : 0.0;
}

double encounter_certainty_margin_m(const Encounter *pair) {
    return KERNEL_TOUCH_M + encounter_distance_error_m(pair, pair->separation_m);
}
