/* Decide whether pairs meet deeper than a margin in an area, of which one piece is a convex part.
 *
 * The depth of a place inside is its distance from the border. Branch and bound: cells of the pair's intersection are
 * halved until a deep place is found, or each cell is proven to have none. The distance from one side, and the sum of
 * distances from two, are convex; so they are largest at a corner of a cell, and no place of the cell is deeper
 *
 * 1. than its middle plus the radius of the cell around it,
 * 2. than its distance from the side nearest to the middle,
 * 3. than half of the sum of its distances from that side and a side across: a strip is no deeper than half its width.
 *
 * As the search for the pole of inaccessibility, with bounds per cell: J. Garcia-Castellanos, U. Lombardo, "Poles of
 * inaccessibility", Scott. Geogr. J. 123 (2007), doi:10.1080/14702540801897809.
 */
#include <stdlib.h>

#include "scene/border.h"

/* Most cells of a pair inspected per instant; beyond it the depth is unknown. */
enum { MAX_LOOKS = 1024 };
/* Most waiting cells, each a half of another cell. */
enum { MAX_WAITING = 128 };
/* Cells within this fraction of the margin around their middle are not halved: depths that exceed the margin by less
 * may be missed. */
static const double RESOLUTION = 0x1p-10;
/* A contact is inspected at its start, middle and end. */
static const double SHARES[] = {0.0, 0.5, 1.0};
enum { INSTANTS = sizeof SHARES / sizeof *SHARES };

typedef struct {
    Vector start, way;
} Side;

typedef struct {
    Vector middle;
    double reach;
} Circle;

/* A box that bounds a cell. */
typedef struct {
    double west, east, south, north;
} Box;

/* State of a cell: no deep place; no border in it; its middle is farther than the margin from the border; undecided;
 * not finite. Places farther than the margin from the border are deep if they are inside. */
typedef enum { IS_SHALLOW, IS_WITHOUT_BORDER, IS_FAR_IN_THE_MIDDLE, IS_OPEN, IS_NOWHERE } CellDepth;

/* The nearby sides of a border, and memory for polygons. */
typedef struct {
    double margin;
    Side *sides;
    int64_t count;
    Polygon common, spare, cell;
    int64_t room;
} Border;

static double squared_from(const Side *side, Vector place) {
    return squared_distance((Vector){place.x - side->start.x, place.y - side->start.y}, side->way);
}

/* The vector from a place to the nearest point of a side. */
static Vector way_to(const Side *side, Vector place) {
    Vector way = {side->start.x - place.x, side->start.y - place.y}, along = side->way;
    double square = along.x * along.x + along.y * along.y, share = -(way.x * along.x + way.y * along.y);
    share = share >= square ? 1.0 : share > 0.0 ? share / square : 0.0;
    return (Vector){way.x + share * along.x, way.y + share * along.y};
}

/* A circle about a point of a convex polygon that contains it. */
static Circle circle_around(const Polygon *polygon) {
    Circle circle = {{0.0, 0.0}, 0.0};
    for (int64_t i = 0; i < polygon->count; i++) circle.middle.x += polygon->x[i], circle.middle.y += polygon->y[i];
    circle.middle.x /= (double)polygon->count, circle.middle.y /= (double)polygon->count;
    for (int64_t i = 0; i < polygon->count; i++)
        circle.reach = most(circle.reach, hypot(polygon->x[i] - circle.middle.x, polygon->y[i] - circle.middle.y));
    return circle;
}

static bool is_somewhere(Circle circle) { return isfinite(circle.middle.x + circle.middle.y + circle.reach); }

/* Collect the sides of an area, relative to an origin, within the margin of a circle; all others are farther from its
 * places. False if the area has no sides, the margin is negative or NaN, or a number is not finite. */
static bool keep_sides(Border *border, const KernelAreas *areas, int64_t area, Vector origin, const Circle *circle) {
    double reach = circle->reach + border->margin;
    bool has_sides = false;
    border->count = 0;
    if (!is_somewhere(*circle) || !(border->margin >= 0.0)) return false;
    for (int64_t r = areas->area_offset[area]; r < areas->area_offset[area + 1]; r++)
        for (int64_t k = areas->ring_offset[r]; k + 1 < areas->ring_offset[r + 1]; k++) {
            const double *xy = areas->ring + 2 * k;
            Side side = {{xy[0] - origin.x, xy[1] - origin.y}, {xy[2] - xy[0], xy[3] - xy[1]}};
            double square = squared_from(&side, circle->middle);
            if (!isfinite(square)) return false;
            if (square <= reach * reach) border->sides[border->count++] = side;
            has_sides = true;
        }
    return has_sides;
}

/* Whether a place off the border is inside an area, relative to an origin: counts the sides to its east. */
static bool is_inside(const KernelAreas *areas, int64_t area, Vector origin, Vector place) {
    double x = place.x + origin.x, y = place.y + origin.y;
    bool is_odd = false;
    for (int64_t r = areas->area_offset[area]; r < areas->area_offset[area + 1]; r++)
        for (int64_t k = areas->ring_offset[r]; k + 1 < areas->ring_offset[r + 1]; k++) {
            const double *xy = areas->ring + 2 * k;
            if ((xy[1] > y) == (xy[3] > y)) continue;
            is_odd ^= xy[0] + (y - xy[1]) / (xy[3] - xy[1]) * (xy[2] - xy[0]) > x;
        }
    return is_odd;
}

/* Largest distance of a polygon's corner from a side, or sum of distances from two. */
static double furthest_from(const Polygon *polygon, const Side *side, const Side *across) {
    double furthest = 0.0;
    for (int64_t i = 0; i < polygon->count; i++) {
        Vector corner = {polygon->x[i], polygon->y[i]};
        double distance = sqrt(squared_from(side, corner)) + (across ? sqrt(squared_from(across, corner)) : 0.0);
        furthest = most(furthest, distance);
    }
    return furthest;
}

/* The side nearest to a place, excluding sides in direction `ahead` unless that is zero. */
static const Side *nearest_side(const Border *border, Vector place, Vector ahead) {
    const Side *nearest = NULL;
    double least2 = INFINITY;
    for (int64_t k = 0; k < border->count; k++) {
        double square = squared_from(border->sides + k, place);
        if (square >= least2) continue;
        if (ahead.x != 0.0 || ahead.y != 0.0) {
            Vector way = way_to(border->sides + k, place);
            if (!(way.x * ahead.x + way.y * ahead.y < 0.0)) continue;
        }
        nearest = border->sides + k, least2 = square;
    }
    return nearest;
}

/* State of a cell, from a circle that contains it. */
static CellDepth depth_of(const Border *border, const Polygon *cell, Circle circle) {
    const Side *side = nearest_side(border, circle.middle, (Vector){0.0, 0.0});
    double margin = border->margin, depth = side ? sqrt(squared_from(side, circle.middle)) : INFINITY;
    /* Not finite: undecided. No side within the margin: all places are farther from the border. */
    if (!is_somewhere(circle) || (!side && border->count > 0)) return IS_NOWHERE;
    if (depth > margin) return depth >= circle.reach ? IS_WITHOUT_BORDER : IS_FAR_IN_THE_MIDDLE;
    if (depth + circle.reach <= margin || circle.reach <= RESOLUTION * margin) return IS_SHALLOW;
    if (furthest_from(cell, side, NULL) <= margin) return IS_SHALLOW;
    const Side *across = depth > 0.0 ? nearest_side(border, circle.middle, way_to(side, circle.middle)) : NULL;
    return across && furthest_from(cell, side, across) <= 2.0 * margin ? IS_SHALLOW : IS_OPEN;
}

static Box box_around(const Polygon *polygon) {
    Box box = {INFINITY, -INFINITY, INFINITY, -INFINITY};
    for (int64_t i = 0; i < polygon->count; i++) {
        box.west = least(box.west, polygon->x[i]), box.east = most(box.east, polygon->x[i]);
        box.south = least(box.south, polygon->y[i]), box.north = most(box.north, polygon->y[i]);
    }
    return box;
}

/* Clip a polygon by a line, using another polygon's memory. */
static bool clip(Polygon *polygon, Polygon *room, Vector start, Vector way, int64_t most_corners) {
    bool is_clipped = polygon_clip(polygon, start, way, room, most_corners);
    Polygon kept = *room;
    *room = *polygon, *polygon = kept;
    return is_clipped;
}

/* Set the cell to the part of the intersection inside a box; false if it does not fit. */
static bool cut_cell(Border *border, const Box *box) {
    Polygon *cell = &border->cell, *spare = &border->spare;
    cell->count = border->common.count;
    for (int64_t i = 0; i < cell->count; i++) cell->x[i] = border->common.x[i], cell->y[i] = border->common.y[i];
    return clip(cell, spare, (Vector){box->west, box->south}, (Vector){1.0, 0.0}, border->room) &&
           clip(cell, spare, (Vector){box->east, box->south}, (Vector){0.0, 1.0}, border->room) &&
           clip(cell, spare, (Vector){box->east, box->north}, (Vector){-1.0, 0.0}, border->room) &&
           clip(cell, spare, (Vector){box->west, box->north}, (Vector){0.0, -1.0}, border->room);
}

/* Whether the intersection has a deep place in an area. */
static KernelDepth search_cells(Border *border, const KernelAreas *areas, int64_t area, Vector origin) {
    Box waiting[MAX_WAITING];
    int64_t count = 0;
    waiting[count++] = box_around(&border->common);
    for (int looks = 0; count > 0; looks++) {
        Box box = waiting[--count], other;
        if (looks >= MAX_LOOKS || count + 2 > MAX_WAITING || !cut_cell(border, &box)) return KERNEL_DEPTH_UNKNOWN;
        if (border->cell.count == 0) continue;
        Circle circle = circle_around(&border->cell);
        CellDepth depth = depth_of(border, &border->cell, circle);
        if (depth == IS_NOWHERE) return KERNEL_DEPTH_UNKNOWN;
        bool is_far = depth == IS_WITHOUT_BORDER || depth == IS_FAR_IN_THE_MIDDLE;
        if (is_far && is_inside(areas, area, origin, circle.middle)) return KERNEL_DEEP;
        if (depth == IS_SHALLOW || depth == IS_WITHOUT_BORDER) continue;
        other = box = box_around(&border->cell);
        if (box.east - box.west > box.north - box.south) other.west = box.east = 0.5 * (box.west + box.east);
        else other.south = box.north = 0.5 * (box.south + box.north);
        waiting[count++] = box, waiting[count++] = other;
    }
    return KERNEL_SHALLOW;
}

/* Compute the intersection of the pair at an instant. */
static void meet_at(Border *border, Encounter *pair, double t) {
    encounter_place(pair, t);
    /* The result is in one of the two; swap their memory. */
    Polygon *common = polygon_common(&pair->a_now, &pair->b_now, &border->common, &border->spare);
    if (common == &border->common) return;
    Polygon found = border->spare;
    border->spare = border->common, border->common = found;
}

/* Depth of a pair in area k; origin: the pair's origin in coordinates of the area; part: the mover that is a part of
 * it. */
static KernelDepth deepest(Border *border, Encounter *pair, const KernelAreas *areas, int64_t k, Vector origin,
                           const Mover *part, double low, double high) {
    KernelDepth found = KERNEL_SHALLOW;
    mover_place(part, low, &pair->a0);
    Circle circle = circle_around(&pair->a0);
    border->margin = areas->margin[k];
    if (!keep_sides(border, areas, k, origin, &circle)) return KERNEL_DEPTH_UNKNOWN;
    /* Often no place of the whole part is deep. */
    if (depth_of(border, &pair->a0, circle) == IS_SHALLOW) return KERNEL_SHALLOW;
    for (int i = 0; i < INSTANTS && found != KERNEL_DEEP; i++) {
        meet_at(border, pair, (1.0 - SHARES[i]) * low + SHARES[i] * high);
        if (border->common.count == 0) continue;
        circle = circle_around(&border->common);
        KernelDepth depth = KERNEL_DEPTH_UNKNOWN;
        if (keep_sides(border, areas, k, origin, &circle)) depth = search_cells(border, areas, k, origin);
        if (depth != KERNEL_SHALLOW) found = depth;
    }
    return found;
}

/* Validate areas, and find the largest number of vertices of one. */
static KernelStatus check_areas(const KernelAreas *areas, int64_t *largest) {
    *largest = 0;
    if (areas->count < 0 || areas->ring_count < 0 || areas->vertex_count < 0) return KERNEL_BAD_COUNT;
    if (!areas->ring_offset || !areas->area_offset || (areas->vertex_count > 0 && !areas->ring)) return KERNEL_NULL;
    if (areas->count > 0 && !areas->margin) return KERNEL_NULL;
    if (areas->ring_offset[0] != 0 || areas->ring_offset[areas->ring_count] != areas->vertex_count) return KERNEL_BAD_OFFSET;
    if (areas->area_offset[0] != 0 || areas->area_offset[areas->count] != areas->ring_count) return KERNEL_BAD_OFFSET;
    for (int64_t r = 0; r < areas->ring_count; r++)
        if (areas->ring_offset[r + 1] < areas->ring_offset[r]) return KERNEL_BAD_OFFSET;
    for (int64_t k = 0; k < areas->count; k++)
        if (areas->area_offset[k + 1] < areas->area_offset[k]) return KERNEL_BAD_OFFSET;
    for (int64_t k = 0; k < areas->count; k++) {
        int64_t size = areas->ring_offset[areas->area_offset[k + 1]] - areas->ring_offset[areas->area_offset[k]];
        *largest = size > *largest ? size : *largest;
    }
    return KERNEL_OK;
}

/* Largest number of vertices of a pair's intersection, clipped to a box. */
static int64_t most_in_common(const Scene *scene, const KernelPairs *pairs) {
    int64_t found = 0;
    for (int64_t i = 0; i < pairs->count; i++) {
        int64_t both = scene->bodies[pairs->a[i]].count + scene->bodies[pairs->b[i]].count;
        found = both > found ? both : found;
    }
    return found + 8;
}

KernelStatus kernel_whole_depths(const KernelScene *scene, const KernelPairs *pairs, const KernelAreas *areas,
                                 const int64_t *area, const int8_t *is_b, const double *east_m, int8_t *depth) {
    double *memory;
    int64_t largest;
    Encounter pair = {.separation_m = 0.0};
    if (!areas || (pairs && pairs->count > 0 && (!area || !is_b || !east_m || !depth))) return KERNEL_NULL;
    KernelStatus status = check_areas(areas, &largest);
    for (int64_t i = 0; status == KERNEL_OK && pairs && i < pairs->count; i++)
        if (area[i] < 0 || area[i] >= areas->count) status = KERNEL_BAD_PIECE;
    if (status == KERNEL_OK) status = border_begin(scene, pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    Border border = {.room = most_in_common(scene, pairs)};
    border.sides = malloc(((size_t)largest + 1) * sizeof *border.sides);
    double *rooms = malloc(6 * (size_t)border.room * sizeof *rooms);
    if (!border.sides || !rooms) status = KERNEL_NO_MEMORY;
    Polygon *polygons[] = {&border.common, &border.spare, &border.cell};
    for (int k = 0; status == KERNEL_OK && k < 3; k++)
        polygons[k]->x = rooms + 2 * k * border.room, polygons[k]->y = polygons[k]->x + border.room;
    for (int64_t i = 0; status == KERNEL_OK && i < pairs->count; i++) {
        depth[i] = KERNEL_DEPTH_UNKNOWN;
        const Mover *part = is_b[i] ? &pair.b : &pair.a;
        if (!border_meet(scene, pairs, i, &pair) || part->body->motion != STANDS_STILL) continue;
        Vector origin = {pair.a.origin.x - east_m[i], pair.a.origin.y};
        depth[i] = (int8_t)deepest(&border, &pair, areas, area[i], origin, part, pairs->low_s[i], pairs->high_s[i]);
    }
    free(border.sides), free(rooms), free(memory);
    return status;
}
