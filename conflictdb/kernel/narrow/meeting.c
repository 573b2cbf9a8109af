/* Meeting points and distances of pairs at an instant. */
#include <stdlib.h>

#include "scene/border.h"
#include "narrow/meeting.h"

Vector encounter_meeting(Encounter *pair, double t) {
    Vector from, to, common;
    encounter_place(pair, t);
    if (polygon_distance(&pair->a_now, &pair->b_now, &from, &to).gap > 0.0) {
        common = (Vector){0.5 * (from.x + to.x), 0.5 * (from.y + to.y)};
    } else {
        /* a0 and a1 are unused here; their memory fits the vertices of both polygons. */
        Polygon room = {.x = pair->a0.x, .y = pair->a1.x};
        common = polygon_common_point(&pair->a_now, &pair->b_now, &room, &pair->spare);
    }
    return (Vector){common.x + pair->a.origin.x, common.y + pair->a.origin.y};
}

KernelStatus kernel_meetings(const KernelScene *scene, const KernelPairs *pairs, double *degrees) {
    double *memory;
    Encounter pair = {.separation_m = 0.0};
    if (pairs && pairs->count > 0 && !degrees) return KERNEL_NULL;
    KernelStatus status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    for (int64_t i = 0; i < pairs->count; i++) {
        degrees[2 * i] = degrees[2 * i + 1] = NAN;
        if (border_meet(scene, pairs, i, &pair))
            plane_degrees(&scene->plane, encounter_meeting(&pair, pairs->low_s[i]), degrees + 2 * i);
    }
    free(memory);
    return KERNEL_OK;
}

KernelStatus kernel_distances(const KernelScene *scene, const KernelPairs *pairs, double *distance_m) {
    double *memory;
    Encounter pair = {.separation_m = 0.0};
    if (pairs && pairs->count > 0 && !distance_m) return KERNEL_NULL;
    KernelStatus status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    for (int64_t i = 0; i < pairs->count; i++) {
        distance_m[i] = NAN;
        if (!border_meet(scene, pairs, i, &pair)) continue;
        encounter_place(&pair, pairs->low_s[i]);
        pair.parts_left = PLANE_MAX_PARTS;
        double found = plane_distance_m(&scene->plane, &pair.a_now, &pair.b_now, pair.a.origin, &pair.parts_left);
        if (pair.parts_left >= 0) distance_m[i] = found;
    }
    free(memory);
    return KERNEL_OK;
}
