/* Merge triangles of polygons into convex parts: at most four times the smallest number of parts.
 *
 * S. Hertel, K. Mehlhorn, "Fast triangulation of the plane with respect to simple polygons", Information and Control 64
 * (1985), doi:10.1016/S0019-9958(85)80044-9.
 *
 * Side k of triangle i has number 3 i + k, and leads from its corner k to the next one. The remaining sides form the
 * cycles around the parts.
 */
#include <stdlib.h>
#include <string.h>

#include "kernel.h"
#include "planes/motion.h"

enum { NONE = -1 };

typedef struct {
    const double *xy;
    int64_t *next, *previous; /* sides around their part */
    int64_t *part;            /* union-find parent of triangles; see `root` */
    int64_t *table;           /* hash table of sides, or NONE */
    int64_t room;             /* size of the table, a power of two: at least twice the sides of a polygon */
} Mesh;

static Vector start_of(const Mesh *mesh, int64_t side) { return (Vector){mesh->xy[2 * side], mesh->xy[2 * side + 1]}; }

static Vector end_of(const Mesh *mesh, int64_t side) { return start_of(mesh, side % 3 == 2 ? side - 2 : side + 1); }

static uint64_t mixed(uint64_t hash, double number) {
    uint64_t bits;
    number += 0.0; /* -0 is 0 */
    memcpy(&bits, &number, sizeof bits);
    hash = (hash ^ bits) * UINT64_C(0x9E3779B97F4A7C15);
    return hash ^ (hash >> 29);
}

static bool is_same(Vector a, Vector b) { return a.x == b.x && a.y == b.y; }

/* The slot of the side from one corner to another, or the slot where it belongs. */
static int64_t *find(const Mesh *mesh, Vector from, Vector to) {
    uint64_t hash = mixed(mixed(mixed(mixed(0, from.x), from.y), to.x), to.y);
    for (uint64_t at = hash;; at++) {
        int64_t *place = mesh->table + (at & (uint64_t)(mesh->room - 1));
        if (*place == NONE || (is_same(start_of(mesh, *place), from) && is_same(end_of(mesh, *place), to))) return place;
    }
}

static int64_t root(const Mesh *mesh, int64_t triangle) {
    while (mesh->part[triangle] != triangle) {
        mesh->part[triangle] = mesh->part[mesh->part[triangle]];
        triangle = mesh->part[triangle];
    }
    return triangle;
}

static bool turns_left(Vector a, Vector b, Vector c) {
    return cross((Vector){b.x - a.x, b.y - a.y}, (Vector){c.x - b.x, c.y - b.y}) >= 0.0;
}

/* Whether the merged part is convex at the start of a removed side. other: the same side in the other direction. */
static bool stays_convex(const Mesh *mesh, int64_t side, int64_t other) {
    return turns_left(start_of(mesh, mesh->previous[side]), start_of(mesh, side), end_of(mesh, mesh->next[other]));
}

static void link_sides(Mesh *mesh, int64_t side, int64_t next) { mesh->next[side] = next, mesh->previous[next] = side; }

/* Merge the triangles [first, end) of one polygon. Removed sides have next = NONE. */
static void join(Mesh *mesh, int64_t first, int64_t end) {
    for (int64_t k = 0; k < mesh->room; k++) mesh->table[k] = NONE;
    for (int64_t side = 3 * first; side < 3 * end; side++) {
        link_sides(mesh, side, side % 3 == 2 ? side - 2 : side + 1);
        *find(mesh, start_of(mesh, side), end_of(mesh, side)) = side;
    }
    for (int64_t side = 3 * first; side < 3 * end; side++) {
        int64_t other = *find(mesh, end_of(mesh, side), start_of(mesh, side));
        if (other <= side || *find(mesh, start_of(mesh, side), end_of(mesh, side)) != side) continue;
        int64_t mine = root(mesh, side / 3), theirs = root(mesh, other / 3);
        if (mine == theirs || !stays_convex(mesh, side, other) || !stays_convex(mesh, other, side)) continue;
        mesh->part[theirs] = mine;
        link_sides(mesh, mesh->previous[side], mesh->next[other]);
        link_sides(mesh, mesh->previous[other], mesh->next[side]);
        mesh->next[side] = mesh->next[other] = NONE;
    }
}

/* Write the corners of the parts, one per remaining side; returns the number of parts. */
static int64_t list_parts(Mesh *mesh, int64_t count, int64_t *corner, int64_t *offset) {
    int64_t parts = 0, corners = 0;
    offset[0] = 0;
    for (int64_t side = 0; side < 3 * count; side++) {
        for (int64_t at = side; mesh->next[at] != NONE;) {
            int64_t next = mesh->next[at];
            corner[corners++] = at, mesh->next[at] = NONE;
            at = next;
        }
        if (corners > offset[parts]) offset[++parts] = corners;
    }
    return parts;
}

KernelStatus kernel_convex_parts(const double *xy, const int64_t *of, int64_t count, int64_t *corner, int64_t *offset,
                                 int64_t *parts) {
    if (count < 0 || count > INT64_MAX / 64) return KERNEL_BAD_COUNT;
    if (!offset || !parts || (count > 0 && (!xy || !of || !corner))) return KERNEL_NULL;
    int64_t largest = 0, room = 1;
    for (int64_t i = 0, first = 0; i < count; i++) {
        if (of[i] != of[first]) first = i;
        largest = i + 1 - first > largest ? i + 1 - first : largest;
    }
    while (room < 6 * largest) room *= 2;
    int64_t *memory = malloc((size_t)(7 * count + room) * sizeof *memory);
    if (!memory) return KERNEL_NO_MEMORY;
    Mesh mesh = {.xy = xy, .next = memory, .previous = memory + 3 * count, .part = memory + 6 * count};
    mesh.table = memory + 7 * count;
    for (int64_t i = 0; i < count; i++) mesh.part[i] = i;
    for (int64_t first = 0, end = 0; first < count; first = end) {
        while (end < count && of[end] == of[first]) end++;
        mesh.room = 1;
        while (mesh.room < 6 * (end - first)) mesh.room *= 2;
        join(&mesh, first, end);
    }
    *parts = list_parts(&mesh, count, corner, offset);
    free(memory);
    return KERNEL_OK;
}
