/* Positions, reference points and bounds of single pieces as functions of time. */
#include <stdlib.h>

#include "planes/bend.h"
#include "planes/plane.h"

/* Validate rows, and find the largest number of vertices of their pieces. */
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

/* Set up the mover of a row; false if its piece or its zero is invalid. */
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
    double *memory = malloc((2 + FRAME) * (size_t)largest * sizeof *memory);
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

KernelStatus kernel_references(const KernelScene *scene, const KernelRows *rows, const double *t, double *xy) {
    int64_t largest;
    KernelStatus status = check_rows(scene, rows, &largest);
    if (status != KERNEL_OK || rows->count == 0) return status;
    if (!t || !xy) return KERNEL_NULL;
    double *frame = malloc(FRAME * (size_t)largest * sizeof *frame);
    if (!frame) return KERNEL_NO_MEMORY;
    for (int64_t i = 0; i < rows->count; i++) {
        Mover mover;
        bool is_there = set_up(scene, rows, i, frame, &mover) && mover.body->motion != STANDS_STILL;
        Vector reference = is_there ? mover_reference(&mover, t[i]) : (Vector){NAN, NAN};
        xy[i] = reference.x, xy[rows->count + i] = reference.y;
    }
    free(frame);
    return KERNEL_OK;
}

/* The largest change of a vertex's offset from the reference point between two instants. */
static double offset_change(const Mover *mover, double t0, double t1, Polygon *start, Polygon *end) {
    double change = 0.0;
    if (mover->body->motion == STANDS_STILL) return change;
    mover_place(mover, t0, start), mover_place(mover, t1, end);
    Vector from = mover_reference(mover, t0), to = mover_reference(mover, t1);
    for (int64_t i = 0; i < start->count; i++)
        change = most(change, hypot((end->x[i] - to.x) - (start->x[i] - from.x), (end->y[i] - to.y) - (start->y[i] - from.y)));
    return change;
}

KernelStatus kernel_bounds(const KernelScene *scene, const KernelRows *rows, const double *t0, const double *t1,
                           const KernelBounds *bounds) {
    int64_t largest;
    KernelStatus status = check_rows(scene, rows, &largest);
    if (status != KERNEL_OK || rows->count == 0) return status;
    if (!t0 || !t1 || !bounds || !bounds->velocity || !bounds->acceleration || !bounds->spread) return KERNEL_NULL;
    if (!bounds->deviation || !bounds->scale || !bounds->curve || !bounds->variation) return KERNEL_NULL;
    double *memory = malloc((4 + FRAME) * (size_t)largest * sizeof *memory);
    if (!memory) return KERNEL_NO_MEMORY;
    Polygon start = {.x = memory, .y = memory + largest}, end = {.x = memory + 2 * largest, .y = memory + 3 * largest};
    for (int64_t i = 0; i < rows->count; i++) {
        Mover mover;
        Vector velocity = {NAN, NAN};
        Bounds found = {NAN, NAN};
        Sweep sweep = {NAN, NAN};
        Acceleration acceleration = {{NAN, NAN}, NAN};
        if (set_up(scene, rows, i, memory + 4 * largest, &mover)) {
            velocity = mover_velocity(&mover, 0.5 * (t0[i] + t1[i]));
            found = mover_bounds(&mover, t0[i], t1[i]);
            acceleration = mover_acceleration(&mover, t0[i], t1[i]);
            sweep = mover_sweep(&mover, t0[i], t1[i], offset_change(&mover, t0[i], t1[i], &start, &end));
        }
        bounds->velocity[i] = velocity.x, bounds->velocity[rows->count + i] = velocity.y;
        bounds->acceleration[i] = found.acceleration, bounds->spread[i] = found.spread;
        bounds->deviation[i] = sweep.deviation, bounds->scale[i] = sweep.scale;
        bounds->curve[i] = acceleration.middle.x, bounds->curve[rows->count + i] = acceleration.middle.y;
        bounds->variation[i] = acceleration.variation;
    }
    free(memory);
    return KERNEL_OK;
}

/* Rounding of boxes, metres on the earth. */
static const double BOX_ROUNDING_M = 1e-6;

/* The box of a mover between two instants: their positions, and how far vertices may leave their chords. */
static void put_box(const Mover *mover, double t0, double t1, double separation_m, Polygon *start, Polygon *end,
                    double box[4]) {
    const KernelPlane *plane = &mover->scene->plane;
    Extent extent = extent_none();
    mover_place(mover, t0, start), mover_place(mover, t1, end);
    extent_add(&extent, start, mover->origin), extent_add(&extent, end, mover->origin);
    double largest = plane_largest_scale(plane, &extent), h = t1 - t0, half = BOX_ROUNDING_M * largest;
    Range x = mover_bend(mover, (Vector){1.0, 0.0}, t0, t1), y = mover_bend(mover, (Vector){0.0, 1.0}, t0, t1);
    if (separation_m > 0.0) half += 0.5 * plane_span_m(plane, separation_m, largest);
    box[0] = extent.west - mover->origin.x - most(x.high, 0.0) * h * h / 8.0 - half;
    box[1] = extent.south - mover->origin.y - most(y.high, 0.0) * h * h / 8.0 - half;
    box[2] = extent.east - mover->origin.x + most(-x.low, 0.0) * h * h / 8.0 + half;
    box[3] = extent.north - mover->origin.y + most(-y.low, 0.0) * h * h / 8.0 + half;
}

KernelStatus kernel_proof_boxes(const KernelScene *scene, const KernelRows *rows, const double *t0, const double *t1,
                                double separation_m, double *box) {
    int64_t largest;
    KernelStatus status = check_rows(scene, rows, &largest);
    if (status != KERNEL_OK || rows->count == 0) return status;
    if (!t0 || !t1 || !box) return KERNEL_NULL;
    if (!(separation_m >= 0.0) || !isfinite(separation_m)) return KERNEL_BAD_DISTANCE;
    double *memory = malloc((4 + FRAME) * (size_t)largest * sizeof *memory);
    if (!memory) return KERNEL_NO_MEMORY;
    Polygon start = {.x = memory, .y = memory + largest}, end = {.x = memory + 2 * largest, .y = memory + 3 * largest};
    for (int64_t i = 0; i < rows->count; i++) {
        Mover mover;
        for (int k = 0; k < 4; k++) box[4 * i + k] = NAN;
        bool is_there =
            set_up(scene, rows, i, memory + 4 * largest, &mover) && t0[i] <= t1[i] && mover_is_there(&mover, t0[i], t1[i]);
        if (is_there) put_box(&mover, t0[i], t1[i], separation_m, &start, &end, box + 4 * i);
    }
    free(memory);
    return KERNEL_OK;
}

KernelStatus kernel_states(const KernelScene *scene, int8_t *state) {
    if (!scene || (scene->count > 0 && !state)) return KERNEL_NULL;
    for (int64_t i = 0; i < scene->count; i++) {
        const Body *body = scene->bodies + i;
        state[i] = !body->is_sound ? KERNEL_PIECE_INVALID : body->is_convex ? KERNEL_PIECE_CONVEX : KERNEL_PIECE_NONCONVEX;
    }
    return KERNEL_OK;
}
