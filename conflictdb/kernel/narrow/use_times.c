/* When each of two pieces uses a place of the other within the separation in time, of contacts whose times are known. */
#include <math.h>
#include <stdbool.h>

#include "narrow/instants.h"
#include "planes/earth.h"

/* An infinite instant stays. */
static int64_t later(int64_t at_us, int64_t by_us) {
    bool is_infinite = at_us == KERNEL_MINUS_INFINITY_US || at_us == KERNEL_INFINITY_US;
    return is_infinite ? at_us : (int64_t)((uint64_t)at_us + (uint64_t)by_us);
}

static int64_t first_of(int64_t a, int64_t b) { return a < b ? a : b; }
static int64_t last_of(int64_t a, int64_t b) { return a > b ? a : b; }

/* The part of a time that is within T of another one. */
static Time near(Time one, Time other, int64_t within_us) {
    return (Time){last_of(one.start_us, later(other.start_us, -within_us)),
                  first_of(one.end_us, later(other.end_us, within_us))};
}

/* Microseconds between instants; infinite where one of them is. */
static double length_us(int64_t start_us, int64_t end_us) {
    if (start_us == KERNEL_INFINITY_US || end_us == KERNEL_MINUS_INFINITY_US) return -INFINITY;
    if (start_us == KERNEL_MINUS_INFINITY_US || end_us == KERNEL_INFINITY_US) return INFINITY;
    return (double)(int64_t)((uint64_t)end_us - (uint64_t)start_us);
}

/* The time between two times; 0 if they meet. */
static double gap_us(Time one, Time other) {
    return most(0.0, most(length_us(one.end_us, other.start_us), length_us(other.end_us, one.start_us)));
}

static void put(KernelUse *use, Time a, Time b) {
    use->a_start_us = a.start_us, use->a_end_us = a.end_us, use->b_start_us = b.start_us, use->b_end_us = b.end_us;
}

/* The length of both times, seconds: the error of what nobody knows; 0 if it is infinite. */
static double error_of_whole(Time a, Time b) {
    double length_s = length_us(first_of(a.start_us, b.start_us), last_of(a.end_us, b.end_us)) / 1e6;
    return isfinite(length_s) ? length_s : 0.0;
}

/* A contact while both pieces are near in time: of areas, or undecided. */
static void use_of_spans(KernelUse *use, Time a, Time b, int64_t within_us) {
    Time of_a = near(a, b, within_us), of_b = near(b, a, within_us);
    bool is_open = use->verdict == KERNEL_UNRESOLVED;
    put(use, of_a, of_b);
    use->error_s = is_open ? error_of_whole(of_a, of_b) : 0.0;
    use->lacking_s = is_open ? NAN : (double)within_us / 1e6 - gap_us(a, b) / 1e6;
    use->lacking_error_s = is_open ? NAN : 0.0;
}

/* The contact of a track with an area that is there T longer at both ends; seconds of the time that they share so. */
static void use_of_area(KernelUse *use, Time area, Time track, bool is_a, double start_s, double end_s, int64_t within_us) {
    Time shared = near(track, area, within_us), met = instants_of(start_s, end_s, shared), there = near(area, met, within_us);
    bool is_open = use->verdict == KERNEL_UNRESOLVED;
    double lacking_s = (double)within_us / 1e6 - gap_us(area, met) / 1e6;
    put(use, is_a ? there : met, is_a ? met : there);
    use->lacking_s = is_open ? NAN : lacking_s;
    use->lacking_error_s = is_open ? NAN : least(use->error_s, lacking_s);
}

/* A use that ends before it starts is unresolved while both pieces are near in time. */
static void put_in_order(KernelUse *use, Time a, Time b, int64_t within_us) {
    if (use->a_start_us <= use->a_end_us && use->b_start_us <= use->b_end_us && use->error_s >= 0.0) return;
    Time of_a = near(a, b, within_us), of_b = near(b, a, within_us);
    put(use, of_a, of_b);
    use->error_s = error_of_whole(of_a, of_b), use->verdict = KERNEL_UNRESOLVED, use->touches = 1;
    use->lacking_s = use->lacking_error_s = use->first_lon_deg = use->first_lat_deg = NAN;
}

KernelStatus kernel_use_times(const KernelUsed *asked, KernelUse *uses) {
    if (!asked) return KERNEL_NULL;
    if (asked->count < 0 || asked->within_us < 0) return KERNEL_BAD_COUNT;
    bool is_given = asked->a_start_us && asked->a_end_us && asked->b_start_us && asked->b_end_us && asked->known;
    if (asked->count > 0 && !(is_given && uses)) return KERNEL_NULL;
    for (int64_t i = 0; i < asked->count; i++) {
        Time a = {asked->a_start_us[i], asked->a_end_us[i]}, b = {asked->b_start_us[i], asked->b_end_us[i]};
        int8_t known = asked->known[i];
        bool is_a = known == KERNEL_USE_OF_AREA_A, is_of_area = is_a || known == KERNEL_USE_OF_AREA_B;
        if (is_of_area && !(asked->start_s && asked->end_s)) return KERNEL_NULL;
        if (known == KERNEL_USE_OF_SPANS) use_of_spans(uses + i, a, b, asked->within_us);
        if (is_of_area)
            use_of_area(uses + i, is_a ? a : b, is_a ? b : a, is_a, asked->start_s[i], asked->end_s[i], asked->within_us);
        put_in_order(uses + i, a, b, asked->within_us);
        uses[i].is_use = 1;
    }
    return KERNEL_OK;
}
