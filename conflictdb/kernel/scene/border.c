/* Validate all input of the library, prepare scenes, and allocate the memory of an encounter. */
#include <stdlib.h>
#include <string.h>

#include "scene/border.h"
#include "geometry/runs.h"

#ifndef KERNEL_FINGERPRINT
#define KERNEL_FINGERPRINT ""
#endif

/* Memory of an encounter, in doubles per vertex: POLYGONS polygons, a spare one of twice the size, two frames of a
 * mover. */
enum { POLYGONS = 6, NUMBERS = 2 * POLYGONS + 4 + 2 * FRAME };

int32_t kernel_abi(void) { return KERNEL_ABI; }

const char *kernel_fingerprint(void) { return KERNEL_FINGERPRINT; }

void kernel_free(void *list) { free(list); }

static bool is_instant(int64_t us) { return us >= -KERNEL_LATEST_US && us <= KERNEL_LATEST_US; }

KernelStatus border_check_plane(const KernelPlane *plane) {
    if (plane->projection != KERNEL_MERCATOR && plane->projection != KERNEL_GNOMONIC) return KERNEL_BAD_PLANE;
    if (plane->harmonics < 0 || plane->harmonics > KERNEL_HARMONICS) return KERNEL_BAD_PLANE;
    bool is_sized = plane->radius_m > 0.0 && plane->radius_m < INFINITY;
    is_sized &= plane->rectifying_m > 0.0 && plane->rectifying_m < INFINITY;
    is_sized &= plane->eccentricity >= 0.0 && plane->eccentricity < 1.0 && plane->oblateness >= 0.0;
    double sum = plane->centre_lon_deg + plane->centre_lat_deg + plane->oblateness;
    for (int k = 0; k < KERNEL_HARMONICS; k++) sum += plane->to_rectifying[k] + plane->to_conformal[k];
    for (int k = 0; k < KERNEL_RADII; k++) sum += plane->conformal_radius[k];
    return is_sized && isfinite(sum) ? KERNEL_OK : KERNEL_BAD_PLANE;
}

KernelStatus border_check_pieces(const KernelPieces *pieces) {
    if (pieces->count < 0 || pieces->vertex_count < 0) return KERNEL_BAD_COUNT;
    /* All sizes below fit into 64 bits and size_t. */
    if (pieces->count > INT64_MAX / (int64_t)sizeof(Body) / 2) return KERNEL_BAD_COUNT;
    if (pieces->vertex_count > INT64_MAX / (int64_t)sizeof(double) / CIRCLE_COLUMNS / 2) return KERNEL_BAD_COUNT;
    if (!pieces->shape_offset || (pieces->vertex_count > 0 && !pieces->shape)) return KERNEL_NULL;
    bool is_whole = pieces->moves && pieces->turn && pieces->start_us && pieces->end_us && pieces->leg_start_us &&
                    pieces->leg_end_us && pieces->leg_start_deg && pieces->leg_end_deg && pieces->bearing_deg;
    if (pieces->count > 0 && !is_whole) return KERNEL_NULL;
    if (pieces->shape_offset[0] != 0) return KERNEL_BAD_OFFSET;
    for (int64_t i = 0; i < pieces->count; i++)
        if (pieces->shape_offset[i + 1] < pieces->shape_offset[i]) return KERNEL_BAD_OFFSET;
    return pieces->shape_offset[pieces->count] == pieces->vertex_count ? KERNEL_OK : KERNEL_BAD_OFFSET;
}

static bool is_shape_finite(const double *shape, const Body *body) {
    for (int64_t k = 2 * body->first; k < 2 * (body->first + body->count); k++)
        if (!isfinite(shape[k])) return false;
    return true;
}

static bool outline_changes(const KernelPieces *pieces, const Body *body) {
    if (!pieces->shape_to || pieces->shape_to == pieces->shape) return false;
    return memcmp(pieces->shape + 2 * body->first, pieces->shape_to + 2 * body->first,
                  2 * sizeof(double) * (size_t)body->count) != 0;
}

static bool prepare_still(const Scene *scene, const KernelPieces *pieces, int64_t piece, Body *body) {
    double turn_m = scene->plane.projection == KERNEL_MERCATOR ? 0x1.921fb54442d18p2 * scene->plane.radius_m : 0.0;
    double *x = scene->columns + body->first, *y = x + scene->vertex_count;
    for (int64_t i = 0; i < body->count; i++) {
        x[i] = pieces->shape[2 * (body->first + i)] + turn_m * pieces->turn[piece];
        y[i] = pieces->shape[2 * (body->first + i) + 1];
    }
    body->motion = STANDS_STILL, body->is_convex = true;
    body->origin = (Vector){x[0], y[0]};
    return true;
}

static bool is_leg_sound(const KernelPieces *pieces, int64_t i) {
    const double *start = pieces->leg_start_deg + 2 * i, *end = pieces->leg_end_deg + 2 * i;
    bool is_timed = is_instant(pieces->start_us[i]) && is_instant(pieces->end_us[i]) && is_instant(pieces->leg_start_us[i]) &&
                    is_instant(pieces->leg_end_us[i]);
    bool is_placed = fabs(start[1]) <= 90.0 && fabs(end[1]) <= 90.0 && fabs(start[0]) <= 1e6 && fabs(end[0]) <= 1e6;
    return is_timed && is_placed && fabs(pieces->bearing_deg[i]) <= 1e6 && pieces->leg_end_us[i] > pieces->leg_start_us[i];
}

void border_prepare(const Scene *scene, const KernelPieces *pieces, int64_t piece) {
    Body *body = scene->bodies + piece;
    *body = (Body){.first = pieces->shape_offset[piece], .leg_start_us = pieces->leg_start_us[piece]};
    body->count = pieces->shape_offset[piece + 1] - body->first;
    if (body->count == 0 || !is_shape_finite(pieces->shape, body)) return;
    if (!pieces->moves[piece]) {
        body->is_sound = prepare_still(scene, pieces, piece, body);
        return;
    }
    if (body->count > KERNEL_MOST_VERTICES) return;
    body->changes = outline_changes(pieces, body);
    if (!is_leg_sound(pieces, piece) || (body->changes && !is_shape_finite(pieces->shape_to, body))) return;
    body->is_sound = scene->plane.projection == KERNEL_MERCATOR ? rhumb_prepare(scene, pieces, piece, body)
                                                                : circle_prepare(scene, pieces, piece, body);
}

KernelStatus kernel_scene_make(const KernelPlane *plane, const KernelPieces *pieces, KernelScene **scene) {
    if (!plane || !pieces || !scene) return KERNEL_NULL;
    *scene = NULL;
    KernelStatus status = border_check_plane(plane);
    if (status == KERNEL_OK) status = border_check_pieces(pieces);
    if (status != KERNEL_OK) return status;
    Scene *made = calloc(1, sizeof *made);
    if (!made) return KERNEL_NO_MEMORY;
    size_t columns = plane->projection == KERNEL_MERCATOR ? RHUMB_COLUMNS : CIRCLE_COLUMNS;
    made->plane = *plane, made->count = pieces->count, made->vertex_count = pieces->vertex_count;
    made->bodies = calloc((size_t)pieces->count + 1, sizeof *made->bodies);
    made->columns = calloc((size_t)pieces->vertex_count * columns + 1, sizeof *made->columns);
    if (!made->bodies || !made->columns) {
        kernel_scene_free(made);
        return KERNEL_NO_MEMORY;
    }
    /* Pages of unused pieces stay untouched. */
    for (int64_t i = 0; i < pieces->count; i++)
        if (!pieces->used || pieces->used[i]) border_prepare(made, pieces, i);
    *scene = made;
    return KERNEL_OK;
}

void kernel_scene_free(KernelScene *scene) {
    if (!scene) return;
    free(scene->bodies);
    free(scene->columns);
    free(scene);
}

/* Validate pairs, and find the largest number of vertices of their pieces. */
static KernelStatus check_pairs(const Scene *scene, const KernelPairs *pairs, int64_t *largest) {
    if (pairs->count < 0) return KERNEL_BAD_COUNT;
    *largest = 1;
    if (pairs->count == 0) return KERNEL_OK;
    if (!pairs->a || !pairs->b || !pairs->zero_us || !pairs->low_s || !pairs->high_s) return KERNEL_NULL;
    for (int64_t i = 0; i < pairs->count; i++) {
        int64_t a = pairs->a[i], b = pairs->b[i];
        if (a < 0 || a >= scene->count || b < 0 || b >= scene->count) return KERNEL_BAD_PIECE;
        int64_t larger = scene->bodies[a].count > scene->bodies[b].count ? scene->bodies[a].count : scene->bodies[b].count;
        *largest = larger > *largest ? larger : *largest;
    }
    return KERNEL_OK;
}

/* Doubles that an encounter needs for polygons of up to `largest` vertices. */
static size_t numbers_of(int64_t largest) { return NUMBERS * (size_t)largest + POLYGONS * (size_t)runs_room(largest); }

/* Divide the memory of an encounter among its polygons. */
static void lay_out(Encounter *pair, double *memory, int64_t largest) {
    Polygon *polygons[POLYGONS] = {&pair->a0, &pair->b0, &pair->a1, &pair->b1, &pair->a_now, &pair->b_now};
    for (int k = 0; k < POLYGONS; k++) {
        polygons[k]->x = memory + 2 * k * largest;
        polygons[k]->y = memory + (2 * k + 1) * largest;
        polygons[k]->bends = memory + NUMBERS * largest + k * runs_room(largest);
    }
    pair->spare.x = memory + 2 * POLYGONS * largest;
    pair->spare.y = pair->spare.x + 2 * largest;
    pair->a.frame = pair->spare.y + 2 * largest;
    pair->b.frame = pair->a.frame + FRAME * largest;
}

bool border_move(const Scene *scene, int64_t piece, int64_t zero_us, double low, double high, Vector origin, Mover *mover) {
    REQUIRE(piece >= 0 && piece < scene->count);
    const Body *body = scene->bodies + piece;
    if (!body->is_sound || !(fabs(low) <= KERNEL_LONGEST_S && fabs(high) <= KERNEL_LONGEST_S)) return false;
    if (body->motion != STANDS_STILL && !is_instant(zero_us)) return false;
    *mover = mover_make(scene, body, zero_us, origin, mover->frame);
    return mover_is_there(mover, low, high);
}

bool border_meet(const Scene *scene, const KernelPairs *pairs, int64_t i, Encounter *pair) {
    REQUIRE(i >= 0 && i < pairs->count && pairs->a[i] < scene->count && pairs->b[i] < scene->count);
    Vector origin = scene->bodies[pairs->a[i]].origin;
    double low = pairs->low_s[i], high = pairs->high_s[i];
    return border_move(scene, pairs->a[i], pairs->zero_us[i], low, high, origin, &pair->a) &&
           border_move(scene, pairs->b[i], pairs->zero_us[i], low, high, origin, &pair->b);
}

KernelStatus border_begin(const Scene *scene, const KernelPairs *pairs, Encounter *pair, double **memory) {
    return border_begin_larger(scene, pairs, 1, pair, memory);
}

KernelStatus border_begin_larger(const Scene *scene, const KernelPairs *pairs, int64_t times, Encounter *pair,
                                 double **memory) {
    int64_t largest;
    if (!scene || !pairs) return KERNEL_NULL;
    if (!(pair->separation_m >= 0.0) || !(pair->margin_m >= 0.0)) return KERNEL_BAD_DISTANCE;
    if (!isfinite(pair->separation_m) || !isfinite(pair->margin_m)) return KERNEL_BAD_DISTANCE;
    KernelStatus status = check_pairs(scene, pairs, &largest);
    if (status != KERNEL_OK) return status;
    if (largest > INT64_MAX / times / (int64_t)sizeof(Body)) return KERNEL_BAD_COUNT;
    largest = times * largest + 1; /* an intersection may have two vertices more than both polygons */
    *memory = malloc(numbers_of(largest) * sizeof **memory);
    if (!*memory) return KERNEL_NO_MEMORY;
    pair->plane = &scene->plane;
    lay_out(pair, *memory, largest);
    return KERNEL_OK;
}
