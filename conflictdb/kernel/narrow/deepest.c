/* How near pairs come, or how deep they overlap, and when most.
 *
 * The signed separation of two pieces in uniform motion is convex in time, so that a few instants around the least of some
 * samples find the worst one. Whether another one is worse a search for contacts proves (kernel_contacts).
 */
#include <stdlib.h>

#include "narrow/meeting.h"
#include "scene/border.h"

enum { SAMPLES = 9 }; /* of the time of a pair */
enum { STEPS = 32 };  /* a golden section each: the worst instant of an hour to a millisecond */
static const double GOLDEN = 0x1.3c6ef372fe95p-1;

/* An instant, and the distance then. */
typedef struct {
    double at, m;
} Sample;

static Sample sample(Encounter *pair, double at) {
    encounter_place(pair, at);
    pair->parts_left = PLANE_MAX_PARTS;
    double m = plane_distance_m(pair->plane, &pair->a_now, &pair->b_now, pair->a.origin, &pair->parts_left);
    return (Sample){at, pair->parts_left >= 0 && !isnan(m) ? m : INFINITY};
}

static void keep_less(Sample *least, Sample other) {
    if (other.m < least->m) *least = other;
}

/* The least distance of the encounter that is set up, where it falls and rises again. */
static Sample least_of(Encounter *pair, double low, double high) {
    double width = (high - low) / (SAMPLES - 1);
    Sample least = sample(pair, low);
    for (int k = 1; k < SAMPLES; k++) keep_less(&least, sample(pair, low + k * width));
    double left = most(low, least.at - width), right = least.at + width < high ? least.at + width : high;
    Sample first = sample(pair, right - GOLDEN * (right - left)), second = sample(pair, left + GOLDEN * (right - left));
    for (int k = 0; k < STEPS; k++) {
        keep_less(&least, first), keep_less(&least, second);
        bool is_left = first.m < second.m;
        if (is_left) right = second.at, second = first;
        else left = first.at, first = second;
        double at = is_left ? right - GOLDEN * (right - left) : left + GOLDEN * (right - left);
        *(is_left ? &first : &second) = sample(pair, at);
    }
    return least;
}

KernelStatus kernel_deepest(const KernelScene *scene, const KernelPairs *pairs, double *least_m, double *at_s) {
    double *memory;
    Encounter pair = {.separation_m = 0.0};
    if (pairs && pairs->count > 0 && !(least_m && at_s)) return KERNEL_NULL;
    KernelStatus status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    for (int64_t i = 0; i < pairs->count; i++) {
        double low = pairs->low_s[i], high = pairs->high_s[i];
        Sample least = {low, INFINITY};
        if (low <= high && border_meet(scene, pairs, i, &pair)) least = least_of(&pair, low, high);
        least_m[i] = least.m, at_s[i] = least.at;
    }
    free(memory);
    return KERNEL_OK;
}
