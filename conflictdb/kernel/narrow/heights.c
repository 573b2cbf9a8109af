/* When the heights of two pieces overlap, if either climbs.
 *
 * Heights are linear along a leg, so bands overlap during one interval, in closed form. Bands that only touch do not overlap:
 * the interval is open, and one instant is none. Intervals are widened by the rounding error of heights, which a slow climb
 * takes long to pass.
 */
#include <float.h>
#include <stdlib.h>

#include "narrow/heights.h"
#include "planes/earth.h"

/* More than the rounding error of a height on the way, relative to the largest height: some ten operations. */
static const double ROUNDING = 32.0 * DBL_EPSILON;

/* Heights of one piece at both ends of a time: floors and ceilings. */
typedef struct {
    double floor, floor_to, ceiling, ceiling_to;
} Climb;

/* When heights overlap: seconds from the start of a time, and by how much each end may be off. first > last: never. */
typedef struct {
    double first, last, error;
} Overlap;

static Climb climb_of(const KernelHeights *pieces, int64_t i) {
    if (!pieces->climb_m) return (Climb){pieces->floor_m[i], pieces->floor_m[i], pieces->ceiling_m[i], pieces->ceiling_m[i]};
    const double *ends = pieces->climb_m + 4 * i;
    return (Climb){ends[0], ends[1], ends[2], ends[3]};
}

static bool climbs(Climb climb) { return climb.floor != climb.floor_to || climb.ceiling != climb.ceiling_to; }

static double finite_size(double height) { return isfinite(height) ? fabs(height) : 0.0; }

/* The height at a share of the leg; heights that do not change may be infinite. */
static double height_at(double from, double to, double share) { return from == to ? from : from + (to - from) * share; }

/* Heights at both ends of a time within the leg. */
static Climb climb_during(const KernelHeights *pieces, int64_t i, int64_t start_us, int64_t end_us) {
    Climb whole = climb_of(pieces, i);
    double length = most(us_between(pieces->leg_start_us[i], pieces->leg_end_us[i]), 1.0);
    double first = us_between(pieces->leg_start_us[i], start_us) / length;
    double last = us_between(pieces->leg_start_us[i], end_us) / length;
    return (Climb){height_at(whole.floor, whole.floor_to, first), height_at(whole.floor, whole.floor_to, last),
                   height_at(whole.ceiling, whole.ceiling_to, first), height_at(whole.ceiling, whole.ceiling_to, last)};
}

/* Cut an interval to the time at which a floor is below a ceiling; both are linear in a span, seconds. */
static void narrow(Overlap *time, double floor, double floor_to, double ceiling, double ceiling_to, double span_s) {
    double size = most(most(finite_size(floor), finite_size(floor_to)), most(finite_size(ceiling), finite_size(ceiling_to)));
    double slack = ROUNDING * size, above = floor - ceiling, above_to = floor_to - ceiling_to;
    bool is_below = above < -slack, is_below_to = above_to < -slack;
    if (!is_below && !is_below_to) time->first = INFINITY;
    if (is_below == is_below_to) return;
    double crossing = span_s * (above / (above - above_to));
    /* Two heights, each rounded and extended. */
    double error_m = 2.0 * slack + 4.0 * KERNEL_HEIGHT_ROUNDING_M;
    double doubt = span_s * (error_m / fabs(above_to - above) + ROUNDING);
    if (is_below) time->last = least(time->last, least(crossing + doubt, span_s));
    else time->first = most(time->first, most(crossing - doubt, 0.0));
    time->error = most(time->error, 2.0 * doubt);
}

/* When a climb overlaps another one during a span, both given at its ends. */
static Overlap overlap_of(Climb a, Climb b, double span_s) {
    Overlap time = {0.0, span_s, 0.0};
    narrow(&time, a.floor, a.floor_to, b.ceiling, b.ceiling_to, span_s);
    narrow(&time, b.floor, b.floor_to, a.ceiling, a.ceiling_to, span_s);
    return time;
}

bool heights_surely_overlap(const KernelHeights *pieces, int64_t a, int64_t b) {
    Climb one = climb_of(pieces, a), other = climb_of(pieces, b);
    return most(one.floor, one.floor_to) < least(other.ceiling, other.ceiling_to) &&
           most(other.floor, other.floor_to) < least(one.ceiling, one.ceiling_to);
}

KernelStatus heights_check(const KernelHeights *pieces, const int64_t *a, const int64_t *b, int64_t count) {
    if (!pieces) return KERNEL_NULL;
    if (count < 0 || pieces->count < 0) return KERNEL_BAD_COUNT;
    if (count > 0 && (!a || !b)) return KERNEL_NULL;
    bool is_whole = pieces->floor_m && pieces->ceiling_m && pieces->start_us && pieces->end_us && pieces->leg_start_us;
    if (pieces->count > 0 && !(is_whole && pieces->leg_end_us)) return KERNEL_NULL;
    for (int64_t i = 0; i < count; i++)
        if (a[i] < 0 || a[i] >= pieces->count || b[i] < 0 || b[i] >= pieces->count) return KERNEL_BAD_PIECE;
    return KERNEL_OK;
}

KernelStatus kernel_height_overlaps(const KernelHeights *pieces, const int64_t *a, const int64_t *b, int64_t count,
                                    double *first_s, double *last_s, double *error_s) {
    KernelStatus status = heights_check(pieces, a, b, count);
    if (status != KERNEL_OK) return status;
    if (count > 0 && (!first_s || !last_s || !error_s)) return KERNEL_NULL;
    for (int64_t i = 0; i < count; i++) {
        Overlap time = {-INFINITY, INFINITY, 0.0};
        if (climbs(climb_of(pieces, a[i])) || climbs(climb_of(pieces, b[i]))) {
            int64_t start = pieces->start_us[a[i]], end = pieces->end_us[a[i]];
            if (pieces->start_us[b[i]] > start) start = pieces->start_us[b[i]];
            if (pieces->end_us[b[i]] < end) end = pieces->end_us[b[i]];
            Climb one = climb_during(pieces, a[i], start, end), other = climb_during(pieces, b[i], start, end);
            time = overlap_of(one, other, us_between(start, end) / 1e6);
        }
        first_s[i] = time.first, last_s[i] = time.last, error_s[i] = time.error;
    }
    return KERNEL_OK;
}

/* Cut the time of a climbing piece to when it may overlap the other piece at any time of that. Returns the doubt of the ends. */
static double cut(const KernelHeights *pieces, int64_t one, int64_t other, int64_t zero_us, double *start_s, double *end_s) {
    Climb climb = climb_of(pieces, one);
    if (!climbs(climb)) return 0.0;
    double span_s = us_between(pieces->leg_start_us[one], pieces->leg_end_us[one]) / 1e6;
    double since_s = us_between(zero_us, pieces->leg_start_us[one]) / 1e6;
    double floor_m = pieces->floor_m[other], ceiling_m = pieces->ceiling_m[other];
    Overlap time = overlap_of(climb, (Climb){floor_m, floor_m, ceiling_m, ceiling_m}, span_s);
    *start_s = most(*start_s, since_s + time.first), *end_s = least(*end_s, since_s + time.last);
    return time.error;
}

double heights_cut(const KernelHeights *pieces, Shifted *one) {
    bool is_open =
        climbs(climb_of(pieces, one->a)) && climbs(climb_of(pieces, one->b)) && !heights_surely_overlap(pieces, one->a, one->b);
    double doubt = is_open ? INFINITY : 0.0;
    doubt += cut(pieces, one->a, one->b, one->a_zero_us, &one->a_start_s, &one->a_end_s);
    return doubt + cut(pieces, one->b, one->a, one->b_zero_us, &one->b_start_s, &one->b_end_s);
}

KernelStatus kernel_level_shifts(const KernelHeights *pieces, const KernelShifts *shifts, double *a_start_s, double *a_end_s,
                                 double *b_start_s, double *b_end_s, double *doubt_s) {
    if (!shifts) return KERNEL_NULL;
    KernelStatus status = heights_check(pieces, shifts->a, shifts->b, shifts->count);
    if (status != KERNEL_OK) return status;
    bool is_whole = shifts->a_zero_us && shifts->b_zero_us && shifts->a_start_s && shifts->a_end_s && shifts->b_start_s;
    bool has_room = a_start_s && a_end_s && b_start_s && b_end_s && doubt_s;
    if (shifts->count > 0 && !(is_whole && shifts->b_end_s && has_room)) return KERNEL_NULL;
    for (int64_t i = 0; i < shifts->count; i++) {
        Shifted one = {
            .a = shifts->a[i], .b = shifts->b[i], .a_zero_us = shifts->a_zero_us[i], .b_zero_us = shifts->b_zero_us[i]};
        one.a_start_s = shifts->a_start_s[i], one.a_end_s = shifts->a_end_s[i];
        one.b_start_s = shifts->b_start_s[i], one.b_end_s = shifts->b_end_s[i];
        doubt_s[i] = heights_cut(pieces, &one);
        a_start_s[i] = one.a_start_s, a_end_s[i] = one.a_end_s, b_start_s[i] = one.b_start_s, b_end_s[i] = one.b_end_s;
    }
    return KERNEL_OK;
}
