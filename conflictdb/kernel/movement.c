/* What the motions promise, piece by piece: where vertices are, how fast the whole goes, and what bounds the rest. */
#include <stdlib.h>

#include "motion.h"

/* Check rows, and tell how many vertices the largest of their pieces has. */
static KernelStatus check_rows(const Scene *scene, const KernelRows *rows, int64_t *largest) {
    if (!scene || !rows) return KERNEL_NULL;
    if (rows->count < 0) return KERNEL_BAD_COUNT;
    *largest = 1;
    if (rows->count == 0) return KERNEL_OK;
    if (!rows->piece || !rows->zero_us || !rows->origin) return KERNEL_NULL;
    for (int64_t i = 0; i < rows->count; i++) {
        if (rows->piece[i] < 0 || rows->piece[i] >= scene->count) return KERNEL_BAD_PIECE;
        int64_t count = scene->bodies[rows->piece[i]].count;
        *largest = count > *largest ? count : *largest;
    }
    return KERNEL_OK;
}

/* Set up the piece of a row; false where it cannot be, or has no instant to count from. */
static bool set_up(const Scene *scene, const KernelRows *rows, int64_t i, double *frame, Mover *mover) {
    const Body *body = scene->bodies + rows->piece[i];
    bool is_timed = rows->zero_us[i] >= -KERNEL_LATEST_US && rows->zero_us[i] <= KERNEL_LATEST_US;
    if (!body->is_sound || (body->motion != STANDS_STILL && !is_timed)) return false;
    Vector origin = {rows->origin[i], rows->origin[rows->count + i]};
    *mover = mover_make(scene, body, rows->zero_us[i], origin, frame);
    return true;
}

KernelStatus kernel_positions(const KernelScene *scene, const KernelRows *rows, const double *t, int64_t slots, double *xy) {
    int64_t largest;
    KernelStatus status = check_rows(scene, rows, &largest);
    if (status != KERNEL_OK || rows->count == 0) return status;
    if (!t || !xy) return KERNEL_NULL;
    if (slots < largest) return KERNEL_BAD_COUNT;
    double *memory = malloc(11 * (size_t)largest * sizeof *memory);
    if (!memory) return KERNEL_NO_MEMORY;
    for (int64_t i = 0; i < rows->count; i++) {
        Mover mover;
        Polygon placed = {.x = memory, .y = memory + largest};
        bool is_placed = set_up(scene, rows, i, memory + 2 * largest, &mover);
        if (is_placed) mover_place(&mover, t[i], &placed);
        for (int64_t k = 0; k < slots; k++) {
            int64_t vertex = k < placed.count ? k : placed.count - 1;
            xy[k * rows->count + i] = is_placed ? placed.x[vertex] : NAN;
            xy[(slots + k) * rows->count + i] = is_placed ? placed.y[vertex] : NAN;
        }
    }
    free(memory);
    return KERNEL_OK;
}

KernelStatus kernel_bounds(const KernelScene *scene, const KernelRows *rows, const double *t0, const double *t1,
                           const KernelBounds *bounds) {
    int64_t largest;
    KernelStatus status = check_rows(scene, rows, &largest);
    if (status != KERNEL_OK || rows->count == 0) return status;
    if (!t0 || !t1 || !bounds || !bounds->velocity || !bounds->acceleration || !bounds->spread) return KERNEL_NULL;
    double *frame = malloc(9 * (size_t)largest * sizeof *frame);
    if (!frame) return KERNEL_NO_MEMORY;
    for (int64_t i = 0; i < rows->count; i++) {
        Mover mover;
        Vector velocity = {NAN, NAN};
        Bounds found = {NAN, NAN};
        if (set_up(scene, rows, i, frame, &mover)) {
            velocity = mover_velocity(&mover, 0.5 * (t0[i] + t1[i]));
            found = mover_bounds(&mover, t0[i], t1[i]);
        }
        bounds->velocity[i] = velocity.x, bounds->velocity[rows->count + i] = velocity.y;
        bounds->acceleration[i] = found.acceleration, bounds->spread[i] = found.spread;
    }
    free(frame);
    return KERNEL_OK;
}

KernelStatus kernel_states(const KernelScene *scene, int8_t *state) {
    if (!scene || (scene->count > 0 && !state)) return KERNEL_NULL;
    for (int64_t i = 0; i < scene->count; i++) {
        const Body *body = scene->bodies + i;
        state[i] = !body->is_sound ? KERNEL_CANNOT_BE : body->is_convex ? KERNEL_CONVEX : KERNEL_MAY_DENT;
    }
    return KERNEL_OK;
}
