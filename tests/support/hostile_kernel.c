/* Throws hostile arrays at the kernel; built with sanitizers, which end the program at the first fault.
 *
 *     hostile_kernel ROUNDS SEED
 *
 * Every array is a block of its own, so that one step beyond its end is seen. Prints how calls ended, and how pairs did.
 */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "draw.h"
#include "kernel.h"

/* Functions that are called, by what they are about; all, unless a fuzzer asks for some. */
enum { PLANES = 1, BROAD = 2, NARROW = 4, BYTES = 8 };
static int about = PLANES | BROAD | NARROW | BYTES;

/* A number that is mostly between low and high, and now and then one that nobody expects. */
static double number(double low, double high, int64_t odd) {
    static const double ODD[] = {0.0, -0.0, NAN, INFINITY, -INFINITY, 1e308, -1e308, 5e-324, 90.0, -90.0, 180.0, 1e9};
    if (below(odd) > 0) return uniform(low, high);
    return below(4) ? ODD[below((int64_t)(sizeof ODD / sizeof *ODD))] : ldexp(uniform(-1.0, 1.0), (int)below(2000) - 1000);
}

static int64_t instant(int64_t low, int64_t high, int64_t odd) {
    static const int64_t ODD[] = {0, INT64_MIN, INT64_MAX, INT64_MIN + 1, INT64_C(1) << 62, -(INT64_C(1) << 62), -1};
    return below(odd) > 0 ? low + below(high - low) : ODD[below((int64_t)(sizeof ODD / sizeof *ODD))];
}

static void *block(int64_t count, size_t size) {
    void *made = malloc((size_t)count * size);
    if (!made && count > 0) exit(3);
    return made;
}

static KernelPlane some_plane(int64_t odd) {
    KernelPlane plane = {.projection = (int32_t)below(2), .radius_m = 6371008.771415, .rectifying_m = 6371008.771415};
    plane.conformal_radius[0] = plane.radius_m;
    plane.centre_lon_deg = uniform(-180.0, 180.0), plane.centre_lat_deg = uniform(-90.0, 90.0);
    if (plane.projection == KERNEL_MERCATOR && below(2)) { /* roughly WGS84 */
        plane.radius_m = 6378137.0, plane.rectifying_m = 6367449.1458, plane.eccentricity = 0.0818191908426;
        plane.oblateness = 0.00335, plane.harmonics = 6;
        plane.to_rectifying[0] = 8.377e-4, plane.to_conformal[0] = -8.377e-4;
        plane.conformal_radius[0] = plane.radius_m, plane.conformal_radius[1] = -21350.0;
    }
    if (below(odd) == 0) plane.projection = (int32_t)draw();
    if (below(odd) == 0) plane.harmonics = (int32_t)draw();
    if (below(odd) == 0) plane.radius_m = number(-1.0, 1.0, 2);
    if (below(odd) == 0) plane.conformal_radius[below(7)] = number(-1e7, 1e7, 2);
    if (below(odd) == 0) plane.centre_lat_deg = number(-90.0, 90.0, 2);
    return plane;
}

/* Vertices about in the order of an ellipse; sizes from a millimetre to half the earth. */
static void shape(double *xy, int64_t count, double middle_x, double middle_y, double size, int64_t odd) {
    for (int64_t i = 0; i < count; i++) {
        double angle = 6.283185307179586 * (double)i / (double)count;
        xy[2 * i] = middle_x + size * cos(angle), xy[2 * i + 1] = middle_y + 0.7 * size * sin(angle);
        if (below(odd) == 0) xy[2 * i + below(2)] = number(-1e7, 1e7, 2);
        if (below(odd) == 0 && i > 0) xy[2 * i] = xy[0], xy[2 * i + 1] = xy[1];
    }
}

/* Ask which hulls are apart; now and then of one that there is not. None is apart from itself. */
static void pair_hulls(const double *hull, const int64_t *offset, int64_t hulls, int64_t calls[16]) {
    const int64_t n = below(20);
    int64_t *a = block(n, 8), *b = block(n, 8);
    uint8_t *apart = block(n, 1);
    for (int64_t i = 0; i < n; i++) {
        a[i] = hulls > 0 && below(200) ? below(hulls) : instant(-3, 20, 2);
        b[i] = hulls > 0 && below(200) ? below(hulls) : instant(-3, 20, 2);
    }
    KernelStatus status = kernel_apart(hull, below(200) ? offset[hulls] : instant(-3, 20, 2), offset, hulls, a, b, n, apart);
    calls[status]++;
    for (int64_t i = 0; status == KERNEL_OK && i < n; i++)
        if (apart[i] > 1 || (apart[i] && a[i] == b[i])) abort();
    free(a), free(b), free(apart);
}

/* Hulls of pieces [first, n), into arrays that have room for n pieces of so many vertices. */
static void make_hulls(const KernelPlane *plane, const KernelPieces *pieces, int64_t first, int64_t n, double reach,
                       int64_t vertices, int64_t calls[16]) {
    if (vertices < 0 || vertices > 1 << 20 || vertices != pieces->vertex_count) vertices = 0;
    double *hull = block(2 * (KERNEL_HULL_PER_VERTEX * vertices + KERNEL_HULL_MORE * n), 8);
    double *deviation = block(n, 8), *size = block(n, 8);
    int64_t *offset = block(n + 1, 8);
    KernelStatus status = kernel_hulls(plane, pieces, first, n, reach, hull, offset, deviation, size);
    calls[status]++;
    for (int64_t k = 0; status == KERNEL_OK && k < 2 * offset[n]; k++)
        if (!isfinite(hull[k])) abort();
    if (status == KERNEL_OK) pair_hulls(hull, offset, n - first, calls);
    free(hull), free(deviation), free(size), free(offset);
}

/* Ask how deep pairs are in areas whose rings are often those of pieces; now and then of an area that there is not. */
static void ask_whole_areas(const KernelScene *scene, const KernelPairs *pairs, const double *xy, int64_t vertices, double size,
                            int64_t odd, int64_t calls[16]) {
    const int64_t n = below(4), rings = below(6), corners = vertices > 0 && below(4) ? below(vertices) + 1 : 0,
                  m = pairs->count;
    double *ring = block(2 * corners, 8), *margin = block(n, 8), *east = block(m, 8);
    int64_t *ring_offset = block(rings + 1, 8), *area_offset = block(n + 1, 8), *area = block(m, 8);
    int8_t *is_b = block(m, 1), *depth = block(m, 1);
    for (int64_t i = 0; i < 2 * corners; i++) ring[i] = below(9 * odd) ? xy[i] : number(-1e7, 1e7, 2);
    for (int64_t r = 0; r <= rings; r++)
        ring_offset[r] = below(20 * odd) ? r * corners / (rings > 0 ? rings : 1) : instant(-2, 50, 2);
    for (int64_t k = 0; k <= n; k++) area_offset[k] = below(20 * odd) ? k * rings / (n > 0 ? n : 1) : instant(-2, 9, 2);
    for (int64_t k = 0; k < n; k++) margin[k] = number(0.0, size, odd);
    for (int64_t i = 0; i < m; i++) {
        area[i] = n > 0 && below(20 * odd) ? below(n) : instant(-3, 9, 2);
        is_b[i] = (int8_t)below(2), east[i] = below(4) ? 0.0 : number(-4e7, 4e7, odd);
    }
    KernelAreas areas = {n, rings, corners, ring, ring_offset, area_offset, margin};
    KernelStatus status = kernel_whole_depths(scene, pairs, &areas, area, is_b, east, depth);
    calls[status]++;
    for (int64_t i = 0; status == KERNEL_OK && i < m; i++)
        if (depth[i] < KERNEL_SHALLOW || depth[i] > KERNEL_DEPTH_UNKNOWN) abort();
    void *blocks[] = {ring, margin, east, ring_offset, area_offset, area, is_b, depth};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) free(blocks[i]);
}

/* Lay parts of a few bytes side by side, and digest them, with offsets that now and then lead elsewhere. */
static void lay_rows(int64_t odd, int64_t calls[16]) {
    const int64_t n = below(6), width = below(4), size = n * width, room = 2 * size + (below(odd) ? 0 : below(9) - 4);
    uint8_t *data = block(size, 1), *rows = block(room < 0 ? 0 : room, 1);
    int64_t *offset = block(n + 1, 8);
    for (int64_t i = 0; i < size; i++) data[i] = (uint8_t)draw();
    for (int64_t i = 0; i <= n; i++) offset[i] = below(odd) ? i * width : instant(-2, 20, 2);
    const KernelPart parts[] = {{data, size, NULL, width}, {data, size, offset, 0}};
    const uint64_t key[] = {(uint64_t)draw(), (uint64_t)draw()};
    uint64_t *digest = block(n, 8);
    calls[kernel_interleave(parts, 2, n, rows, room)]++;
    calls[kernel_digests(parts, 2, n, key, digest)]++;
    free(data), free(rows), free(offset), free(digest);
}

/* Join triangles whose corners are often the same, of a few polygons; now and then far off, or no numbers. */
static void join_triangles(int64_t odd, int64_t calls[16]) {
    const int64_t n = below(30);
    double *xy = block(6 * n, 8);
    int64_t *of = block(n, 8), *corner = block(3 * n, 8), *offset = block(n + 1, 8), parts;
    for (int64_t i = 0; i < 6 * n; i++) xy[i] = below(odd) ? (double)below(3) : number(-1e7, 1e7, 2);
    for (int64_t i = 0; i < n; i++) of[i] = i / 8;
    KernelStatus status = kernel_convex_parts(xy, of, below(200) ? n : -1, corner, offset, &parts);
    calls[status]++;
    for (int64_t k = 0; status == KERNEL_OK && k < offset[parts]; k++)
        if (corner[k] < 0 || corner[k] >= 3 * n) abort();
    free(xy), free(of), free(corner), free(offset);
}

/* Bundle boxes, and tell which of two bundles meet; now and then of bundles that there are not, or without room. */
static void bundle_boxes(int64_t odd, int64_t calls[16]) {
    const int64_t n = below(30), pairs = below(6);
    double *boxes = block(4 * n, 8);
    int64_t *run = block(n, 8), *order = block(n, 8), *start = block(n, 8), *end = block(n, 8), *offset = block(n + 1, 8);
    uint8_t *moves = block(n, 1), *begins = block(n, 1), *inclusive = block(n, 1), *is_copy = block(n, 1);
    double *heights = block(n + 1, 8);
    for (int64_t i = 0; i < 4 * n; i++) boxes[i] = number(-10.0, 10.0, odd) + (i % 4 > 1 ? 10.0 : 0.0);
    for (int64_t i = 0; i < n; i++) {
        run[i] = i / 9, moves[i] = (uint8_t)(run[i] % 2), inclusive[i] = (uint8_t)below(2);
        heights[i] = number(-10.0, 10.0, odd), is_copy[i] = (uint8_t)below(2);
        start[i] = instant(10 * (i % 9), 10 * (i % 9) + 10, odd), end[i] = instant(start[i] % 1000, start[i] % 1000 + 20, odd);
    }
    KernelStatus status = kernel_bundles(boxes, run, moves, below(200) ? n : -1, order, begins);
    calls[status]++;
    int64_t bundles = 0, found;
    for (int64_t i = 0; status == KERNEL_OK && i < n; i++) {
        if (order[i] < 0 || order[i] >= n || (i == 0 && !begins[i])) abort();
        if (begins[i]) offset[bundles++] = i;
    }
    offset[bundles] = below(200) ? n : instant(-3, 20, 2);
    int64_t *a = block(pairs, 8), *b = block(pairs, 8), room = n * n * pairs, *first = block(room, 8), *second = block(room, 8);
    for (int64_t i = 0; i < pairs; i++) {
        a[i] = bundles > 0 && below(200) ? below(bundles) : instant(-3, 20, 2);
        b[i] = bundles > 0 && below(200) ? below(bundles) : instant(-3, 20, 2);
    }
    const KernelBoxes pieces = {n,   below(200) ? boxes : NULL, heights, heights + 1, start, end, run, is_copy, inclusive, NULL,
                                NULL};
    const KernelCompared compared = {instant(0, 20, odd), 0, NULL};
    status = kernel_bundled_pairs(&pieces, below(200) ? offset : NULL, bundles, below(200) ? &compared : NULL, a, b, pairs,
                                  first, second, below(9) ? room : below(3), &found);
    calls[status]++;
    for (int64_t k = 0; status == KERNEL_OK && k < found; k++)
        if (first[k] < 0 || first[k] >= n || second[k] < 0 || second[k] >= n) abort();
    free(boxes), free(run), free(order), free(start), free(end), free(offset), free(moves), free(begins), free(inclusive);
    free(heights), free(is_copy), free(a), free(b), free(first), free(second);
}

/* Order boxes, and tell which meet; now and then of rows that there are not, or without room. */
static void meet_boxes(int64_t odd, int64_t calls[16]) {
    const int64_t n = below(40), wanted = below(40), room = below(3) ? n * wanted : below(5);
    double *boxes = block(4 * n, 8), *floor_m = block(n, 8), *ceiling_m = block(n, 8);
    int64_t *start = block(n, 8), *end = block(n, 8), *object = block(n, 8), *order = block(n, 8), *of = block(wanted, 8);
    int64_t *first = block(room, 8), *second = block(room, 8), done, found, looked_at;
    int64_t *numbers = block(KERNEL_NUMBERS * n, 8), *type = block(n, 8);
    uint8_t *is_copy = block(n, 1), *inclusive = block(n, 1), *met = block(wanted, 1), of_types[9];
    for (int64_t i = 0; i < 9; i++) of_types[i] = (uint8_t)below(2);
    for (int64_t i = 0; i < 4 * n; i++) boxes[i] = number(-10.0, 10.0, odd) + (i % 4 > 1 ? 10.0 : 0.0);
    for (int64_t i = 0; i < KERNEL_NUMBERS * n; i++) numbers[i] = below(4);
    for (int64_t i = 0; i < n; i++) {
        inclusive[i] = (uint8_t)below(2), type[i] = below(20 * odd) ? below(3) : instant(-3, 5, 2);
        floor_m[i] = number(-10.0, 10.0, odd), ceiling_m[i] = number(-10.0, 30.0, odd), is_copy[i] = (uint8_t)below(2);
        start[i] = instant(0, 50, odd), end[i] = instant(0, 100, odd), object[i] = below(odd) ? below(n) : (int64_t)draw();
    }
    KernelBoxes rows = {below(200) ? n : -1,
                        boxes,
                        floor_m,
                        ceiling_m,
                        start,
                        end,
                        below(200) ? object : NULL,
                        below(200) ? is_copy : NULL,
                        below(3) ? inclusive : NULL,
                        below(3) ? numbers : NULL,
                        below(3) ? type : NULL};
    KernelStatus status = kernel_box_order(&rows, order);
    calls[status]++;
    for (int64_t i = 0; status == KERNEL_OK && i < n; i++)
        if (order[i] < 0 || order[i] >= n) abort();
    for (int64_t i = 0; i < wanted; i++) of[i] = n > 0 && below(20 * odd) ? below(n) : instant(-3, 20, 2);
    const KernelCompared compared = {instant(0, 20, odd), below(50) ? 3 : -1, below(3) ? of_types : NULL};
    status = kernel_box_pairs(&rows, below(200) ? &compared : NULL, of, wanted, first, second, room, &done, &found, &looked_at);
    calls[status]++;
    if (status == KERNEL_OK && (done < 0 || done > wanted || found > room)) abort();
    for (int64_t k = 0; status == KERNEL_OK && k < found; k++)
        if (first[k] < 0 || first[k] >= n || second[k] < 0 || second[k] >= n) abort();
    KernelBoxes others = rows;
    others.boxes = below(3) ? boxes : NULL;
    for (int64_t k = 0; k < room && k < wanted; k++) first[k] = n > 0 && below(20 * odd) ? below(n) : instant(-3, 50, 2);
    status = kernel_may_meet(&rows, &others, below(200) ? &compared : NULL, of, first, room < wanted ? room : wanted, met);
    calls[status]++;
    for (int64_t k = 0; status == KERNEL_OK && k < room && k < wanted; k++)
        if (met[k] > 1) abort();
    KernelBoxTree *tree = NULL;
    status = kernel_box_tree_make(&rows, below(200) ? &tree : NULL);
    calls[status]++;
    rows.count = below(200) ? n : -1;
    status = kernel_box_tree_pairs(tree, &rows, below(200) ? &compared : NULL, first, second, room, &found);
    calls[status]++;
    for (int64_t k = 0; status == KERNEL_OK && k < found && k < room; k++)
        if (first[k] < 0 || first[k] >= n || second[k] < 0 || second[k] >= n) abort();
    kernel_box_tree_free(tree);
    free(boxes), free(floor_m), free(ceiling_m), free(start), free(end), free(object), free(order), free(of);
    free(first), free(second), free(is_copy), free(inclusive), free(numbers), free(type), free(met);
}

/* Read polygons, some of several rings, from bytes that are now and then others, or fewer. */
static void read_polygons(int64_t odd, int64_t calls[16]) {
    const int64_t n = below(5), most = n * (9 + 3 * (13 + 16 * 3)), room = below(9) ? most / 16 : below(4);
    uint8_t *wkb = block(most, 1);
    int64_t *offset = block(n + 1, 8), rings = 0, size = 0;
    for (int64_t i = 0; i < n; i++) {
        int64_t parts = 1 + below(3);
        offset[i] = below(odd) ? size : instant(-3, 20, 2);
        if (parts > 1) {
            const uint8_t head[] = {1, 6, 0, 0, 0, (uint8_t)parts, 0, 0, 0};
            for (int64_t k = 0; k < 9; k++) wkb[size++] = head[k];
        }
        for (int64_t part = 0; part < parts; part++, rings++) {
            const uint8_t head[] = {1, 3, 0, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0};
            for (int64_t k = 0; k < 13; k++) wkb[size++] = below(10 * odd) ? head[k] : (uint8_t)draw();
            for (int64_t k = 0; k < 48; k++) wkb[size++] = (uint8_t)draw();
        }
    }
    offset[n] = below(odd) ? size : instant(-3, 20, 2);
    if (below(50) == 0) rings += below(3) - 1;
    double *xy = block(2 * room, 8);
    int64_t *ring_offset = block(rings < 0 ? 0 : rings + 1, 8);
    KernelStatus status = kernel_wkb_rings(wkb, size, offset, n, xy, room, ring_offset, rings);
    calls[status]++;
    if (status == KERNEL_OK && ring_offset[rings] > room) abort();
    free(wkb), free(offset), free(xy), free(ring_offset);
}

/* Put rings together; now and then one that crosses itself, or offsets that are none. */
static void join_rings(int64_t odd, int64_t calls[16]) {
    enum { CORNERS = 7 };
    const int64_t n = below(20), vertices = n * CORNERS;
    double *ring = block(2 * vertices, 8), *joined = block(2 * vertices, 8);
    int64_t *offset = block(n + 1, 8), *owner = block(n, 8), *ends = block(n + 1, 8), *owners = block(n, 8), found = 0;
    for (int64_t i = 0; i <= n; i++) offset[i] = below(odd) ? i * CORNERS : instant(-2, 200, 2);
    for (int64_t i = 0; i < n; i++) {
        owner[i] = i / 8;
        shape(ring + 2 * i * CORNERS, CORNERS - 1, number(-1.0, 1.0, odd), number(-1.0, 1.0, odd), 1.0, odd);
        for (int k = 0; k < 2; k++) ring[2 * (i + 1) * CORNERS - 2 + k] = ring[2 * i * CORNERS + k];
    }
    int64_t told = below(200) ? vertices : instant(-3, 20, 2);
    KernelStatus status = kernel_joined(ring, told, offset, owner, n, joined, ends, owners, &found);
    calls[status]++;
    if (status == KERNEL_OK && (found > n || ends[found] > vertices)) abort();
    free(ring), free(joined), free(offset), free(owner), free(ends), free(owners);
}

/* Write rings as outlines: convex or not, united or with holes, at any place, with little room. */
static void draw_outlines(const KernelPlane *plane, double size, int64_t odd, int64_t calls[16]) {
    enum { CORNERS = 7 };
    const int64_t n = below(12), vertices = n * CORNERS, count = below(8), room = below(2) ? below(4000) : 40000;
    double *ring = block(2 * vertices, 8), *place = block(2 * count, 8);
    int64_t *ring_offset = block(n + 1, 8), *offset = block(count + 1, 8), *ends = block(count + 1, 8), done = 0;
    int8_t *is_hole = block(n, 1), *what = block(count, 1);
    uint8_t *bytes = block(room, 1);
    for (int64_t i = 0; i <= n; i++) ring_offset[i] = below(20 * odd) ? i * CORNERS : instant(-3, 200, 2);
    for (int64_t i = 0; i <= count; i++) offset[i] = below(20 * odd) ? i * n / (count > 0 ? count : 1) : instant(-3, 20, 2);
    for (int64_t i = 0; i < n; i++) {
        double x = number(-2.0, 2.0, odd) * 1e7, y = number(-1.0, 1.0, odd) * 1e7;
        /* Rings of one region lie near each other. */
        if (i > 0 && below(3)) x = ring[2 * (i - 1) * CORNERS] + number(-size, size, odd), y = ring[2 * (i - 1) * CORNERS + 1];
        shape(ring + 2 * i * CORNERS, CORNERS - 1, x, y, size, odd);
        for (int k = 0; k < 2; k++) ring[2 * (i + 1) * CORNERS - 2 + k] = ring[2 * i * CORNERS + k];
        is_hole[i] = (int8_t)(below(3) == 0);
    }
    for (int64_t i = 0; i < 2 * count; i++) place[i] = number(-180.0, 180.0, 3);
    KernelRings rings = {count,  below(200) ? n : -1,      below(200) ? vertices : instant(-3, 20, 2), ring, ring_offset,
                         offset, below(2) ? is_hole : NULL};
    double limit_m = below(20 * odd) ? number(0.01, 1000.0, odd) : -1.0;
    KernelStatus status =
        kernel_outlines(below(200) ? plane : NULL, &rings, limit_m, below(2) ? place : NULL, bytes, room, ends, what, &done);
    calls[status]++;
    if (status == KERNEL_OK && (done > count || (done > 0 && ends[done] > room))) abort();
    void *blocks[] = {ring, place, ring_offset, offset, ends, is_hole, what, bytes};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) free(blocks[i]);
}

static double some_guess(void *of, int64_t pair, double low, double high, int32_t is_last) {
    return of || pair < 0 || is_last > 1 ? 0.0 : number(low, high, 4);
}

/* Ask where pieces are and how they move: rows of pieces, now and then too few slots, or pieces that there are not. */
static void ask_rows(const KernelScene *scene, int64_t pieces, int64_t slots, int64_t odd, int64_t calls[16]) {
    const int64_t hour = INT64_C(3600000000), n = below(20), room = slots + below(3);
    int64_t *piece = block(n, 8), *zero = block(n, 8);
    double *origin = block(2 * n, 8), *t0 = block(n, 8), *t1 = block(n, 8), *xy = block(2 * room * n, 8);
    double *velocity = block(2 * n, 8), *acceleration = block(n, 8), *spread = block(n, 8);
    double *deviation = block(n, 8), *scale = block(n, 8), *reference = block(2 * n, 8);
    double *curve = block(2 * n, 8), *variation = block(n, 8);
    int8_t *state = block(pieces, 1);
    for (int64_t i = 0; i < n; i++) {
        piece[i] = pieces > 0 && below(20 * odd) ? below(pieces) : instant(-3, 20, 2), zero[i] = instant(0, hour, odd);
        origin[i] = number(-1e7, 1e7, odd), origin[n + i] = number(-1e7, 1e7, odd);
        t0[i] = number(0.0, 3600.0, odd), t1[i] = number(0.0, 7200.0, odd);
    }
    KernelRows rows = {below(50 * odd) ? n : -1, piece, zero, below(50 * odd) ? origin : NULL};
    KernelBounds bounds = {velocity, acceleration, below(50 * odd) ? spread : NULL,   deviation,
                           scale,    curve,        below(50 * odd) ? variation : NULL};
    calls[kernel_positions(scene, &rows, t0, below(20 * odd) ? room : below(slots + 1) - 1, xy)]++;
    calls[kernel_references(scene, &rows, t1, reference)]++;
    calls[kernel_bounds(scene, &rows, t0, t1, &bounds)]++;
    if (scene) calls[kernel_states(scene, state)]++;
    double *box = block(4 * n, 8);
    calls[kernel_proof_boxes(scene, &rows, t0, t1, below(2) ? 0.0 : number(0.0, 1e5, odd), box)]++;
    void *blocks[] = {piece,  zero,      origin, t0,    t1,        xy,        velocity, acceleration,
                      spread, deviation, scale,  curve, variation, reference, state,    box};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) free(blocks[i]);
}

/* Ask where pairs meet; rings have room for them, and for no more. */
static void ask_legs(const KernelPlane *plane, int64_t odd, int64_t calls[16]) {
    int64_t count = 1 + below(6), corners = 0;
    double *way = block(2 * count, 8), *found = block(2 * (count + 4), 8), *rate = block(2 * (count + 4), 8);
    for (int64_t i = 0; i < 2 * count; i++) way[i] = i > 1 && below(3) == 0 ? way[i - 2] : number(-200.0, 200.0, odd);
    int64_t given = below(20 * odd) ? count : -1;
    calls[kernel_headings(below(20 * odd) ? plane : NULL, way, given, found)]++;
    calls[kernel_degrees(plane, way, given, found)]++;
    KernelStatus status = kernel_mitred(way, given, found, rate, below(20 * odd) ? &corners : NULL);
    if (status == KERNEL_OK && (corners < 3 || corners > (count > 4 ? count : 4))) exit(4);
    calls[status]++;
    free(way), free(found), free(rate);
}

/* Ask for directions: steps come in the order of pairs, and end no later than their pair. */
static void ask_directions(const KernelScene *scene, const KernelPairs *pairs, double separation_m, int64_t calls[16]) {
    KernelDirection *found = NULL;
    KernelWork work;
    int64_t count = 0;
    KernelStatus status = kernel_directions(scene, pairs, separation_m, &found, &count, &work);
    calls[status]++;
    for (int64_t i = 0, pair = -1; i < count; pair = found[i++].pair) {
        if (found[i].pair < pair || found[i].pair > pair + 1 || found[i].pair >= pairs->count) exit(4);
        if (!isnan(found[i].angle) && !(found[i].until_s <= pairs->high_s[found[i].pair])) exit(4);
    }
    kernel_free(found);
}

static void ask_regions(const KernelScene *scene, const KernelPairs *pairs, const int64_t *offset, int64_t n, double reach,
                        int64_t calls[16]) {
    int64_t room = KERNEL_REGION_MORE * pairs->count, *ring_offset = block(2 * pairs->count + 1, 8);
    for (int64_t i = 0; scene && i < pairs->count; i++) {
        int64_t a = pairs->a[i], b = pairs->b[i];
        if (a < 0 || a >= n || b < 0 || b >= n) continue;
        room += KERNEL_REGION_PER_VERTEX * (offset[a + 1] - offset[a] + offset[b + 1] - offset[b]);
    }
    double *ring = block(2 * room, 8);
    int8_t *what = block(pairs->count, 1);
    KernelStatus status = kernel_regions(scene, pairs, reach, ring, ring_offset, what);
    calls[status]++;
    for (int64_t k = 0; status == KERNEL_OK && k < 2 * ring_offset[2 * pairs->count]; k++)
        if (!isfinite(ring[k])) abort();
    free(ring), free(ring_offset), free(what);
}

/* Cut times of pieces, and of pairs of them, to when heights overlap. */
static void level_shifts(const KernelShifts *shifts, int64_t m, int64_t odd, int64_t calls[16]) {
    const int64_t hour = INT64_C(3600000000), n = 10;
    double *climb = block(4 * n, 8), *floor = block(n, 8), *ceiling = block(n, 8), *found = block(5 * m, 8);
    int64_t *instants = block(4 * n, 8);
    for (int64_t k = 0; k < 4 * n; k++) climb[k] = number(-50.0, 50.0, odd), instants[k] = instant(0, hour, odd);
    for (int64_t k = 0; k < n; k++) floor[k] = number(-50.0, 0.0, odd), ceiling[k] = number(0.0, 50.0, odd);
    KernelHeights heights = {
        below(50 * odd) ? n : -1, below(4) ? climb : NULL, floor, below(50 * odd) ? ceiling : NULL, instants, instants + n,
        instants + 2 * n,         instants + 3 * n};
    double *room = below(50 * odd) ? found : NULL;
    calls[kernel_height_overlaps(&heights, shifts->a, shifts->b, shifts->count, found, found + m, room)]++;
    calls[kernel_level_shifts(&heights, shifts, found, found + m, found + 2 * m, found + 3 * m, room)]++;
    free(climb), free(floor), free(ceiling), free(found), free(instants);
}

/* Ask for uses of one place by pieces of a scene, complete them, and merge them. */
static void ask_uses(const KernelScene *scene, const KernelPieces *pieces, const KernelPairs *pairs, double reach, int64_t odd,
                     int64_t calls[16]) {
    const int64_t hour = INT64_C(3600000000), n = pieces->count < 0 ? 0 : pieces->count,
                  m = pairs->count < 4 ? pairs->count : 4;
    double *floor = block(n, 8), *ceiling = block(n, 8), *start_s = block(m, 8), *end_s = block(m, 8), *error = block(m, 8);
    double *lacking = block(2 * m, 8), *of_groups = block(9, 8);
    int64_t *spans = block(4 * m, 8), *group = block(m, 8), *found = block(3 * m, 8), *periods = block(2 * m, 8);
    int64_t *order_offset = block(4, 8), *period_offset = block(4, 8);
    int8_t *known = block(m, 1), *verdict = block(m, 1), *verdicts = block(3, 1);
    uint8_t *touches = block(m, 1), *flags = block(6, 1);
    KernelUse *uses = block(m, sizeof *uses);
    KernelWork work;
    for (int64_t i = 0; i < n; i++) floor[i] = number(-50.0, 0.0, odd), ceiling[i] = number(0.0, 50.0, odd);
    KernelHeights heights = {
        n, NULL, floor, ceiling, pieces->start_us, pieces->end_us, pieces->leg_start_us, pieces->leg_end_us};
    KernelUsesAsked asked = {m, instant(0, hour, 2 * odd), reach, number(0.0, reach + 1.0, odd), pairs->a, pairs->b};
    KernelStatus status = kernel_uses(scene, &heights, &asked, uses, &work);
    calls[status]++;
    for (int64_t i = 0; i < m; i++) {
        if (status != KERNEL_OK || below(2))
            uses[i] = (KernelUse){.verdict = (int32_t)below(3), .error_s = number(0.0, 9.0, odd)};
        known[i] = (int8_t)below(5), start_s[i] = number(0.0, 1800.0, odd), end_s[i] = start_s[i] + number(0.0, 900.0, odd);
        for (int k = 0; k < 4; k++) spans[k * m + i] = instant(0, hour, odd);
    }
    KernelUsed used = {
        below(50 * odd) ? m : -1, instant(0, hour, odd), spans, spans + m, spans + 2 * m, spans + 3 * m, known, start_s,
        below(9) ? end_s : NULL};
    calls[kernel_use_times(&used, uses)]++;
    for (int64_t i = 0; i < m; i++) {
        group[i] = below(20 * odd) ? below(3) : instant(-2, 9, 2), verdict[i] = (int8_t)below(3),
        touches[i] = (uint8_t)below(2);
        error[i] = number(0.0, 9.0, odd), lacking[i] = number(0.0, 9.0, odd), lacking[m + i] = number(0.0, 9.0, odd);
    }
    KernelTouching touching = {m,
                               3,
                               group,
                               spans,
                               spans + m,
                               start_s,
                               end_s,
                               error,
                               verdict,
                               touches,
                               below(3) ? lacking : NULL,
                               below(9) ? lacking + m : NULL};
    KernelMerged merged = {found,   found + m,     found + 2 * m, order_offset,
                           periods, period_offset, of_groups,     verdicts,
                           flags,   flags + 3,     of_groups + 3, below(50 * odd) ? of_groups + 6 : NULL};
    status = kernel_merge(&touching, &merged);
    calls[status]++;
    for (int64_t k = 0; status == KERNEL_OK && k < period_offset[3]; k++)
        if (periods[2 * k] > periods[2 * k + 1]) abort();
    void *blocks[] = {floor,   ceiling,      start_s,       end_s, error,   lacking,  of_groups, spans, group, found,
                      periods, order_offset, period_offset, known, verdict, verdicts, touches,   flags, uses};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) free(blocks[i]);
}

/* Ask for differences of departure, or for factors of time; each piece has a zero and a time of its own, now and then one that is none. */
static void ask_differences(const KernelScene *scene, const KernelPairs *pairs, double reach, int64_t odd, int64_t calls[16]) {
    const int64_t hour = INT64_C(3600000000), m = pairs->count < 8 ? pairs->count : 8, is_factor = below(2);
    int64_t *zero = block(m, 8);
    double *low = block(m, 8), *high = block(m, 8), *least = block(m, 8), *most = block(m, 8), *weight = block(m, 8);
    KernelDifference *found = block(m, sizeof *found);
    KernelWork work;
    for (int64_t i = 0; i < m; i++) {
        zero[i] = instant(0, hour, odd), low[i] = number(0.0, 1800.0, odd), high[i] = low[i] + number(0.0, 5400.0, odd);
        if (below(4) == 0) low[i] = high[i] = 0.0;
        least[i] = number(-7200.0, 7200.0, odd), most[i] = below(4) == 0 ? INFINITY : number(-7200.0, 7200.0, odd);
        weight[i] = number(0.01, 100.0, odd);
        if (is_factor) least[i] = number(0.01, 1.0, odd), most[i] = number(1.0, 100.0, odd);
    }
    KernelShifts shifts = {below(50 * odd) ? m : -1,
                           is_factor,
                           pairs->a,
                           pairs->b,
                           pairs->zero_us,
                           zero,
                           pairs->low_s,
                           pairs->high_s,
                           low,
                           below(50 * odd) ? high : NULL,
                           below(50 * odd) ? least : NULL,
                           most,
                           below(2) ? weight : NULL};
    KernelStatus status = kernel_differences(scene, &shifts, reach, found, &work);
    calls[status]++;
    KernelDifferencePart *parts = NULL;
    int64_t count = 0, pair = 0;
    calls[kernel_difference_parts(scene, &shifts, reach, below(50 * odd) ? &parts : NULL, &count, &work)]++;
    for (int64_t k = 0; k < count; pair = parts[k++].pair)
        if (parts[k].pair < pair || parts[k].pair >= m || parts[k].found.state == KERNEL_DIFFERENCE_NONE) abort();
    kernel_free(parts);
    level_shifts(&shifts, m, odd, calls);
    int8_t *near = block(m, 1);
    calls[kernel_near_in_time(scene, &shifts, reach, below(50 * odd) ? instant(0, hour, odd) : -1, near, &work)]++;
    free(near);
    for (int64_t i = 0; status == KERNEL_OK && i < m; i++) {
        const KernelDifference *one = found + i;
        bool is_none = one->state == KERNEL_DIFFERENCE_NONE, is_inner = one->state == KERNEL_DIFFERENCE_INNER;
        if (one->state < 0 || one->state > KERNEL_DIFFERENCE_UNKNOWN) abort();
        if (is_none == (one->outer_low <= one->outer_high)) abort();
        if (is_inner != (one->inner_low <= one->inner_high)) abort();
        if (is_inner && !(one->outer_low <= one->inner_low && one->inner_high <= one->outer_high)) abort();
    }
    free(zero), free(low), free(high), free(least), free(most), free(weight), free(found);
}

static void play(int64_t calls[16], int64_t outcomes[4]) {
    static const int64_t ODDS[] = {3, 30, 1000, INT64_C(1) << 40};
    const int64_t hour = INT64_C(3600000000), odd = ODDS[below(4)], n = below(10), m = below(40);
    KernelPlane plane = some_plane(20 * odd);
    int64_t *offset = block(n + 1, 8), most = below(50) ? 9 : 200;
    offset[0] = 0;
    for (int64_t i = 0; i < n; i++) offset[i + 1] = offset[i] + (below(odd) ? 1 + below(most) : 0);
    KernelPieces pieces = {.count = n, .vertex_count = offset[n], .shape_offset = offset};
    const int64_t vertices = offset[n];
    double *xy = block(2 * vertices, 8), *to = block(2 * vertices, 8);
    int8_t *moves = block(n, 1);
    int16_t *turn = block(n, 2);
    int64_t *start = block(n, 8), *end = block(n, 8), *leg_start = block(n, 8), *leg_end = block(n, 8);
    double *from_deg = block(2 * n, 8), *to_deg = block(2 * n, 8), *bearing = block(n, 8);
    double lon = plane.centre_lon_deg, lat = plane.projection ? plane.centre_lat_deg : uniform(-89.9, 89.9);
    double size = pow(10.0, uniform(-3.0, 6.5)), reach = size / 1e5;
    for (int64_t i = 0; i < n; i++) {
        moves[i] = (int8_t)(below(3) > 0), turn[i] = (int16_t)(below(odd) ? 0 : draw());
        leg_start[i] = instant(0, hour, odd), leg_end[i] = leg_start[i] > hour ? leg_start[i] : leg_start[i] + below(2 * hour);
        start[i] = below(odd) ? leg_start[i] : instant(0, hour, 2), end[i] = below(odd) ? leg_end[i] : instant(0, hour, 2);
        from_deg[2 * i] = lon + number(-reach, reach, odd), to_deg[2 * i] = lon + number(-reach, reach, odd);
        from_deg[2 * i + 1] = lat + number(-reach, reach, odd), to_deg[2 * i + 1] = lat + number(-reach, reach, odd);
        bearing[i] = number(-360.0, 360.0, odd);
        double x = moves[i] ? 0.0 : 111e3 * lon, y = moves[i] ? 0.0 : 111e3 * lat;
        shape(xy + 2 * offset[i], offset[i + 1] - offset[i], x, y, size, 20 * odd);
        shape(to + 2 * offset[i], offset[i + 1] - offset[i], x, y, size * uniform(0.5, 2.0), 20 * odd);
    }
    pieces.moves = moves, pieces.turn = turn, pieces.start_us = start, pieces.end_us = end;
    pieces.leg_start_us = leg_start, pieces.leg_end_us = leg_end, pieces.leg_start_deg = from_deg;
    pieces.leg_end_deg = to_deg, pieces.bearing_deg = bearing, pieces.shape = xy, pieces.shape_to = below(2) ? to : NULL;
    if (below(odd) == 0) offset[below(n + 1)] = instant(-2, 20, 2);
    if (below(20 * odd) == 0) pieces.count = -1;
    if (below(20 * odd) == 0) pieces.vertex_count = instant(-5, 0, 2) < 0 ? -1 : INT64_MAX;
    if (below(20 * odd) == 0) pieces.bearing_deg = NULL;
    KernelScene *scene = NULL;
    KernelStatus status = kernel_scene_make(&plane, &pieces, &scene);
    calls[status]++;
    if (about & BYTES) lay_rows(odd, calls);
    if (about & BYTES) join_triangles(odd, calls);
    if (about & BROAD) bundle_boxes(odd, calls);
    if (about & BROAD) meet_boxes(odd, calls);
    if (about & BYTES) read_polygons(odd, calls);
    if (about & BYTES) join_rings(odd, calls);
    if (about & BYTES) draw_outlines(&plane, size, odd, calls);
    if (about & BROAD) make_hulls(&plane, &pieces, below(20 * odd) ? 0 : -1, n, number(0.0, 1e5, odd), offset[n], calls);

    int64_t *a = block(m, 8), *b = block(m, 8), *zero = block(m, 8);
    double *low = block(m, 8), *high = block(m, 8), *beyond = block(m, 8), *distance = block(m, 8);
    int64_t *company = block(m, 8);
    for (int64_t i = 0; i < m; i++) {
        a[i] = n > 0 && below(20 * odd) ? below(n) : instant(-3, 20, 2),
        b[i] = n > 0 && below(20 * odd) ? below(n) : instant(-3, 20, 2);
        zero[i] = instant(0, hour, odd), low[i] = number(0.0, 1800.0, odd), high[i] = low[i] + number(0.0, 5400.0, odd);
    }
    KernelPairs pairs = {m, a, b, zero, low, high};
    KernelWork work;
    for (int64_t i = 0; i < m; i++) {
        /* A small share of the work each, else hopeless pairs take most of the time. */
        beyond[i] = number(0.0, 5400.0, 3), company[i] = instant(1000, 100000, 3 * odd);
    }
    KernelQuestion question = {below(2) ? 0.0 : number(0.0, 10.0 * size, odd), below(2) ? 0.0 : number(0.0, size, odd),
                               .pairs_of_objects = company};
    if (below(2)) question.beyond_s = beyond;
    if (below(3) == 0) question.guess = some_guess;
    KernelContact *contacts = NULL;
    int64_t found = 0;
    if (about & NARROW) calls[kernel_contacts(scene, &pairs, &question, &contacts, &found, &work)]++;
    for (int64_t i = 0, pair = -1; i < found; pair = contacts[i++].pair) {
        if (contacts[i].pair < pair || contacts[i].pair >= m) exit(4);
        outcomes[contacts[i].verdict]++;
    }
    kernel_free(contacts);
    double *degrees = block(2 * m, 8);
    if (about & NARROW) calls[kernel_meetings(scene, &pairs, degrees)]++;
    if (about & NARROW) calls[kernel_distances(scene, &pairs, distance)]++;
    KernelPairs few = {m < 4 ? m : 4, a, b, zero, low, high};
    if (about & NARROW) calls[kernel_deepest(scene, &few, distance, below(50 * odd) ? beyond : NULL)]++;
    if (about & BYTES) ask_regions(scene, &pairs, offset, n, number(0.0, 1e5, odd), calls);
    if (about & NARROW) ask_directions(scene, &pairs, below(2) ? 0.0 : number(0.0, size, odd), calls);
    if (about & PLANES) ask_legs(&plane, odd, calls);
    if (about & NARROW) ask_differences(scene, &pairs, below(2) ? 0.0 : number(0.0, 10.0 * size, odd), odd, calls);
    if (about & NARROW && below(8) == 0)
        ask_uses(scene, &pieces, &pairs, below(2) ? 0.0 : number(0.0, 10.0 * size, odd), odd, calls);
    if (about & NARROW) ask_whole_areas(scene, &pairs, xy, vertices, size, odd, calls);
    int64_t groups = below(4), *group_offset = block(groups + 1, 8), *closest = block(groups, 8);
    double *wanted = block(groups, 8), *at = block(groups, 8), *apart = block(groups, 8), *doubt = block(groups, 8);
    double *aim = block(groups, 8);
    double *place_a = block(2 * groups, 8), *place_b = block(2 * groups, 8);
    group_offset[0] = 0, group_offset[groups] = below(20 * odd) ? m : instant(-2, 50, 2);
    for (int64_t g = 1; g < groups; g++) group_offset[g] = below(20 * odd) ? g * m / groups : instant(-2, 50, 2);
    for (int64_t g = 0; g < groups; g++) wanted[g] = below(2) ? INFINITY : number(0.0, 1e7, odd);
    for (int64_t g = 0; g < groups; g++) aim[g] = below(2) ? 0.0 : number(0.0, 1e5, odd);
    KernelGroups in_groups = {groups, group_offset, wanted, aim};
    if (about & NARROW)
        calls[kernel_approaches(scene, &pairs, &in_groups, closest, at, apart, doubt, place_a, place_b, &work)]++;
    void *of_groups[] = {group_offset, closest, wanted, aim, at, apart, doubt, place_a, place_b};
    for (size_t i = 0; i < sizeof of_groups / sizeof *of_groups; i++) free(of_groups[i]);
    free(degrees);
    int64_t slots = 1;
    for (int64_t i = 0; scene && i < n; i++) slots = offset[i + 1] - offset[i] > slots ? offset[i + 1] - offset[i] : slots;
    if (about & PLANES) ask_rows(scene, n, slots, odd, calls);
    kernel_scene_free(scene);
    void *blocks[] = {offset, xy,      to, moves, turn, start, end,  leg_start, leg_end, from_deg,
                      to_deg, bearing, a,  b,     zero, low,   high, beyond,    company, distance};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) free(blocks[i]);
}

#ifndef DRAWN_FROM_BYTES
int main(int count, char **arguments) {
    int64_t calls[16] = {0}, outcomes[4] = {0}, rounds = count > 1 ? atoll(arguments[1]) : 1000;
    state = 88172645463325252u + (count > 2 ? (uint64_t)atoll(arguments[2]) : 0u);
    for (int64_t i = 0; i < rounds; i++) play(calls, outcomes);
    printf("status");
    for (int i = 0; i < 9; i++) printf(" %lld", (long long)calls[i]);
    printf("\noutcome %lld %lld %lld\n", (long long)outcomes[0], (long long)outcomes[1], (long long)outcomes[2]);
    return 0;
}
#endif
