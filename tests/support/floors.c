/* What the kernel's bounds say of the distance of pairs during their times, for tests: linked with the kernel. */
#include <stdlib.h>

#include "narrow/approach.h"
#include "narrow/zone.h"
#include "scene/border.h"

/* middle, bound, box : (count,) metres, as approach_during and approach_at_least tell; NaN where a piece cannot be. */
int floors(const KernelScene *scene, const KernelPairs *pairs, double *middle, double *bound, double *box) {
    double *memory;
    KernelWork work = {0};
    Encounter pair = {.work = &work};
    KernelStatus status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    for (int64_t i = 0; i < pairs->count; i++) {
        double low = pairs->low_s[i], high = pairs->high_s[i];
        middle[i] = bound[i] = box[i] = NAN;
        if (!border_meet(scene, pairs, i, &pair)) continue;
        pair.parts_left = PLANE_MAX_PARTS;
        double first = approach_distance(&pair, low), last = approach_distance(&pair, high);
        During during = approach_during(&pair, low, high, first, last, INFINITY);
        middle[i] = during.middle, bound[i] = during.bound;
        box[i] = approach_at_least(&pair, low, high);
    }
    free(memory);
    return 0;
}

/* is_near : (count,) whether zone_is_near proves that the pieces stay nearer than separation_m during the time. */
int stays_near(const KernelScene *scene, const KernelPairs *pairs, double separation_m, uint8_t *is_near) {
    double *memory;
    KernelWork work = {0};
    Encounter pair = {.work = &work};
    KernelStatus status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    encounter_ask(&pair, separation_m, 0.0);
    for (int64_t i = 0; i < pairs->count; i++) {
        is_near[i] = 0;
        if (!border_meet(scene, pairs, i, &pair)) continue;
        pair.parts_left = PLANE_MAX_PARTS;
        is_near[i] = zone_is_near(&pair, pairs->low_s[i], pairs->high_s[i]);
    }
    free(memory);
    return 0;
}
