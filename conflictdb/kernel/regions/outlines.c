/* Regions as polygons in longitude and latitude: united, traced, judged and written as well-known binary. */
#include <stdlib.h>
#include <string.h>

#include "scene/border.h"
#include "regions/rings.h"

/* Rings of more vertices that form no two chains, and regions of more vertices in several rings, are not judged: each side
 * would be compared with each other. */
enum { MOST_COMPARED = 256 };
/* Directions along which rings are tried. Sides across the first two may turn back by rounding. */
static const Vector DIRECTIONS[] = {{1.0, 0.0}, {0.8, 0.6}, {0.0, 1.0}};
enum { SRID = 4326, POLYGON = 3, MULTIPOLYGON = 6, WITH_SRID = 0x20000000, HEAD_BYTES = 9, COUNT_BYTES = 4, VERTEX_BYTES = 16 };

static double along(Vector direction, const double *at) { return direction.x * at[0] + direction.y * at[1]; }

/* Whether a ring is certainly simple: from its first to its last vertex along a direction lead two chains that never turn
 * back, and each vertex of one lies on its own side of the other. */
static bool has_two_chains(const double (*v)[2], int64_t n, Vector direction) {
    int64_t low = 0, high = 0;
    for (int64_t i = 1; i < n; i++) {
        if (along(direction, v[i]) < along(direction, v[low])) low = i;
        if (along(direction, v[i]) > along(direction, v[high])) high = i;
    }
    int64_t right = low, left = low;
    while (right != high || left != high) {
        int64_t next_right = right + 1 < n ? right + 1 : 0, next_left = left > 0 ? left - 1 : n - 1;
        bool is_right = left == high || (right != high && along(direction, v[next_right]) <= along(direction, v[next_left]));
        int64_t from = is_right ? right : left, to = is_right ? next_right : next_left;
        if (!(along(direction, v[to]) > along(direction, v[from]))) return false;
        if (to != high) {
            double turn = is_right ? turn_of(v[left], v[next_left], v[to]) : -turn_of(v[right], v[next_right], v[to]);
            if (!(turn < 0.0)) return false;
        }
        if (is_right) right = to;
        else left = to;
    }
    return true;
}

/* Whether two sides are certainly apart. */
static bool are_apart(const double *a, const double *b, const double *c, const double *d) {
    for (int k = 0; k < 2; k++)
        if (fmax(a[k], b[k]) < fmin(c[k], d[k]) || fmin(a[k], b[k]) > fmax(c[k], d[k])) return true;
    double one = turn_of(a, b, c), other = turn_of(a, b, d);
    if ((one > 0.0 && other > 0.0) || (one < 0.0 && other < 0.0)) return true;
    one = turn_of(c, d, a), other = turn_of(c, d, b);
    return (one > 0.0 && other > 0.0) || (one < 0.0 && other < 0.0);
}

/* Whether no side of a ring touches another of its own, except the next at their corner, by comparing all. */
static bool is_simple_by_sides(const double (*v)[2], int64_t n) {
    if (n > MOST_COMPARED) return false;
    for (int64_t i = 0; i < n; i++) {
        int64_t end = i + 1 < n ? i + 1 : 0, after = end + 1 < n ? end + 1 : 0;
        if (v[i][0] == v[end][0] && v[i][1] == v[end][1]) return false;
        /* The next side may turn back onto this one. */
        double x = v[end][0] - v[i][0], y = v[end][1] - v[i][1], next_x = v[after][0] - v[end][0],
               next_y = v[after][1] - v[end][1];
        if (turn_of(v[i], v[end], v[after]) == 0.0 && x * next_x + y * next_y <= 0.0) return false;
        for (int64_t k = i + 2; k < n; k++) {
            int64_t other = k + 1 < n ? k + 1 : 0;
            if (other != i && !are_apart(v[i], v[end], v[k], v[other])) return false;
        }
    }
    return true;
}

static bool is_simple(const double (*v)[2], int64_t n, bool is_hole) {
    for (size_t k = 0; !is_hole && k < sizeof DIRECTIONS / sizeof *DIRECTIONS; k++)
        if (has_two_chains(v, n, DIRECTIONS[k])) return true;
    return is_simple_by_sides(v, n) && (ring_doubled_area(v, n) > 0.0) != is_hole;
}

typedef struct {
    double low[2], high[2];
} RingBox;

static RingBox box_of(const Rings *rings, int64_t ring) {
    RingBox bounds = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
    for (int64_t i = rings->offset[ring]; i < rings->offset[ring + 1]; i++)
        for (int k = 0; k < 2; k++) {
            bounds.low[k] = fmin(bounds.low[k], rings->vertex[i][k]);
            bounds.high[k] = fmax(bounds.high[k], rings->vertex[i][k]);
        }
    return bounds;
}

static bool overlap(const RingBox *a, const RingBox *b) {
    for (int k = 0; k < 2; k++)
        if (a->high[k] < b->low[k] || a->low[k] > b->high[k]) return false;
    return true;
}

/* Whether two rings certainly do not touch, and neither contains the other unless one is a hole. */
static bool do_not_touch(const Rings *rings, int64_t one, int64_t other) {
    RingBox a = box_of(rings, one), b = box_of(rings, other);
    if (!overlap(&a, &b)) return true;
    const int64_t *offset = rings->offset;
    if (offset[one + 1] - offset[one] > MOST_COMPARED || offset[other + 1] - offset[other] > MOST_COMPARED) return false;
    for (int64_t i = offset[one]; i < offset[one + 1]; i++) {
        int64_t end = i + 1 < offset[one + 1] ? i + 1 : offset[one];
        for (int64_t k = offset[other]; k < offset[other + 1]; k++) {
            int64_t last = k + 1 < offset[other + 1] ? k + 1 : offset[other];
            if (!are_apart(rings->vertex[i], rings->vertex[end], rings->vertex[k], rings->vertex[last])) return false;
        }
    }
    if (rings->is_hole[one] || rings->is_hole[other]) return true;
    int64_t own[2] = {0, offset[one + 1] - offset[one]}, its[2] = {0, offset[other + 1] - offset[other]};
    Rings first = {rings->vertex + offset[one], own, NULL, 1, own[1], 0, 0};
    Rings last = {rings->vertex + offset[other], its, NULL, 1, its[1], 0, 0};
    return rings_hold(&first, rings->vertex[offset[other]]) == 0 && rings_hold(&last, rings->vertex[offset[one]]) == 0;
}

/* Return what is known of a region, which moves by whole turns into 180 degrees of longitude. */
static int8_t judge(Rings *rings, const double *place) {
    double west = INFINITY, east = -INFINITY, highest = 0.0;
    for (int64_t i = 0; i < rings->vertices; i++) {
        const double *v = rings->vertex[i];
        if (!isfinite(v[0]) || !isfinite(v[1])) return KERNEL_OUTLINE_UNKNOWN;
        west = fmin(west, v[0]), east = fmax(east, v[0]), highest = fmax(highest, fabs(v[1]));
    }
    if (!(highest < 90.0)) return KERNEL_OUTLINE_UNKNOWN;
    double home = west >= 180.0 ? -360.0 : east <= -180.0 ? 360.0 : 0.0;
    for (int64_t i = 0; i < rings->vertices && home != 0.0; i++) rings->vertex[i][0] += home;
    if (west + home < -180.0 || east + home > 180.0) return KERNEL_OUTLINE_BEYOND;
    for (int64_t i = 0; i < rings->count; i++) {
        int64_t first = rings->offset[i];
        const double (*v)[2] = (const double (*)[2])(rings->vertex + first);
        if (!is_simple(v, rings->offset[i + 1] - first, rings->is_hole[i])) return KERNEL_OUTLINE_CROSSED;
        for (int64_t k = 0; k < i; k++)
            if (!do_not_touch(rings, k, i)) return KERNEL_OUTLINE_CROSSED;
    }
    bool is_given = place && isfinite(place[0]) && isfinite(place[1]);
    return is_given && rings_hold(rings, place) != 1 ? KERNEL_OUTLINE_AWAY : KERNEL_OUTLINE_SOUND;
}

static uint8_t *put_number(uint8_t *to, uint64_t number, int bytes) {
    for (int i = 0; i < bytes; i++) to[i] = (uint8_t)(number >> (8 * i));
    return to + bytes;
}

/* Write byte order, type and count. */
static uint8_t *put_head(uint8_t *to, uint32_t type, bool has_srid, int64_t count) {
    to = put_number(to, 1, 1), to = put_number(to, type | (has_srid ? WITH_SRID : 0), 4);
    if (has_srid) to = put_number(to, SRID, 4);
    return put_number(to, (uint64_t)count, COUNT_BYTES);
}

/* The rings from a shell to the next. */
static int64_t rings_of(const Rings *rings, int64_t shell) {
    int64_t end = shell + 1;
    while (end < rings->count && rings->is_hole[end]) end++;
    return end - shell;
}

/* Write a region in EWKB, little-endian; returns its end. */
static uint8_t *write_region(const Rings *rings, int64_t shells, uint8_t *to) {
    if (shells > 1) to = put_head(to, MULTIPOLYGON, true, shells);
    for (int64_t ring = 0; ring < rings->count; ring++) {
        int64_t first = rings->offset[ring], count = rings->offset[ring + 1] - first;
        if (!rings->is_hole[ring]) to = put_head(to, POLYGON, shells == 1, rings_of(rings, ring));
        to = put_number(to, (uint64_t)count + 1, COUNT_BYTES);
        for (int64_t i = 0; i <= count; i++) {
            for (int k = 0; k < 2; k++) {
                uint64_t bits;
                memcpy(&bits, &rings->vertex[first + (i < count ? i : 0)][k], sizeof bits);
                to = put_number(to, bits, 8);
            }
        }
    }
    return to;
}

/* What a call works with. */
typedef struct {
    Uniting *uniting;
    Tracing *tracing;
    Rings plane, degrees;
    bool has_memory;
} Bench;

/* Copy the rings of a region, each of which is closed. */
static bool copy_rings(Bench *bench, const double *ring, const int64_t *offset, const int8_t *is_hole, int64_t count) {
    bench->has_memory = rings_make_room(&bench->plane, count, offset[count] - offset[0]);
    for (int64_t i = 0; i < count && bench->has_memory; i++) {
        for (int64_t k = offset[i]; k < offset[i + 1] - 1; k++) rings_add(&bench->plane, ring[2 * k], ring[2 * k + 1]);
        rings_end(&bench->plane, is_hole && is_hole[i]);
    }
    return bench->has_memory && count > 0 && !bench->plane.is_hole[0];
}

/* Whether the boxes of all rings of a region are apart. */
static bool boxes_are_apart(const Rings *rings) {
    for (int64_t i = 0; i < rings->count; i++) {
        RingBox one = box_of(rings, i);
        for (int64_t k = 0; k < i; k++) {
            RingBox other = box_of(rings, k);
            if (overlap(&one, &other)) return false;
        }
    }
    return true;
}

/* Make the outline of a region from its rings; false if it is unknown, or if its rings could not be united. */
static bool outline(Bench *bench, const double *ring, const int64_t *offset, const int8_t *is_hole, int64_t count,
                    int8_t *what) {
    rings_clear(&bench->plane), rings_clear(&bench->degrees);
    *what = KERNEL_OUTLINE_UNKNOWN;
    if (!copy_rings(bench, ring, offset, is_hole, count)) return false;
    if (!is_hole && count > 1 && !boxes_are_apart(&bench->plane)) {
        rings_clear(&bench->plane);
        *what = KERNEL_OUTLINE_CROSSED;
        if (!unite(bench->uniting, ring, offset, count, &bench->plane, &bench->has_memory)) return false;
        *what = KERNEL_OUTLINE_UNKNOWN;
    }
    for (int64_t i = 0; i < bench->plane.count; i++) {
        const double (*v)[2] = (const double (*)[2])(bench->plane.vertex + bench->plane.offset[i]);
        int64_t vertices = bench->plane.offset[i + 1] - bench->plane.offset[i];
        if (!trace(bench->tracing, v, vertices, bench->plane.is_hole[i], &bench->degrees, &bench->has_memory)) return false;
    }
    return true;
}

static KernelStatus check_offsets(const int64_t *offset, int64_t count, int64_t end) {
    if (offset[0] != 0 || offset[count] != end) return KERNEL_BAD_OFFSET;
    for (int64_t i = 0; i < count; i++)
        if (offset[i + 1] < offset[i]) return KERNEL_BAD_OFFSET;
    return KERNEL_OK;
}

static KernelStatus check_rings(const KernelRings *rings) {
    if (rings->count < 0 || rings->ring_count < 0 || rings->vertex_count < 0) return KERNEL_BAD_COUNT;
    if (rings->vertex_count > INT64_MAX / 1024 || rings->ring_count > INT64_MAX / 1024) return KERNEL_BAD_COUNT;
    if (!rings->offset || !rings->ring_offset || (rings->vertex_count > 0 && !rings->vertex)) return KERNEL_NULL;
    KernelStatus status = check_offsets(rings->offset, rings->count, rings->ring_count);
    return status == KERNEL_OK ? check_offsets(rings->ring_offset, rings->ring_count, rings->vertex_count) : status;
}

KernelStatus kernel_outlines(const KernelPlane *plane, const KernelRings *rings, double limit_m, const double *place,
                             uint8_t *bytes, int64_t room, int64_t *byte_offset, int8_t *what, int64_t *done) {
    if (!plane || !rings || !byte_offset || !done || (rings->count > 0 && !what) || (room > 0 && !bytes)) return KERNEL_NULL;
    KernelStatus status = border_check_plane(plane);
    if (status == KERNEL_OK) status = check_rings(rings);
    if (status != KERNEL_OK) return status;
    if (room < 0) return KERNEL_BAD_COUNT;
    if (!(limit_m >= 0.01 && limit_m <= 1e5)) return KERNEL_BAD_DISTANCE;
    Bench bench = {.uniting = uniting_make(), .tracing = tracing_make(plane, limit_m), .has_memory = true};
    bench.has_memory = bench.uniting && bench.tracing;
    *done = 0, byte_offset[0] = 0;
    for (int64_t i = 0; i < rings->count && bench.has_memory; i++) {
        int64_t first = rings->offset[i], count = rings->offset[i + 1] - first;
        const int64_t *offset = rings->ring_offset + first;
        byte_offset[i + 1] = byte_offset[i];
        if (outline(&bench, rings->vertex, offset, rings->is_hole ? rings->is_hole + first : NULL, count, what + i)) {
            what[i] = judge(&bench.degrees, place ? place + 2 * i : NULL);
            int64_t shells = 0;
            for (int64_t k = 0; k < bench.degrees.count; k++) shells += !bench.degrees.is_hole[k];
            int64_t size = HEAD_BYTES + (HEAD_BYTES + COUNT_BYTES) * (bench.degrees.count + 1) +
                           VERTEX_BYTES * (bench.degrees.vertices + bench.degrees.count);
            if (size > room - byte_offset[i]) break;
            if (what[i] != KERNEL_OUTLINE_UNKNOWN)
                byte_offset[i + 1] = write_region(&bench.degrees, shells, bytes + byte_offset[i]) - bytes;
        }
        if (bench.has_memory) ++*done;
    }
    uniting_free(bench.uniting), tracing_free(bench.tracing);
    rings_free(&bench.plane), rings_free(&bench.degrees);
    return bench.has_memory ? KERNEL_OK : KERNEL_NO_MEMORY;
}
