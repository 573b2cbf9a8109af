/* Which differences of departure bring two pieces into contact, with proofs.
 *
 * Piece a is at A(u) at its own time u, piece b at B(v). The contact set
 *
 *     C = {(u, v) in [u0, u1] x [v0, v1] : A(u) and B(v) come within reach of each other}
 *
 * does not depend on departures: a track that departs d later is at A(t - d) at t, so it meets b if and only if d = v - u
 * for some (u, v) in C (coordination space: P. A. O'Donnell, T. Lozano-Perez, ICRA 1989, doi:10.1109/ROBOT.1989.100035;
 * S. M. LaValle, "Planning Algorithms" (2006), 7.2).
 *
 * Proof from outside. Along a fixed unit vector n the gap is g(u, v) = min n.B(v) - max n.A(u). If vertices moved on their
 * chords, the minimum would be concave in v, and the maximum convex in u. They leave them by at most M h^2 / 8. So g is at
 * least a function that is affine in (u, v): each vector cuts a half-plane off the box, and v - u is largest at a corner
 * of the convex part that is left. With a reach the vertices bring their halves of it (plane_half_m).
 *
 * The box shrinks to the part beyond the largest difference seen in contact. The slack decreases with the square of the
 * box. A box that does not shrink is halved, the one with the largest bound first.
 *
 * Proof from inside. If contact lasts on a way between two points of C (shift.c), each difference between theirs is one of
 * contact.
 */
#include <stdlib.h>

#include "scene/border.h"
#include "narrow/shift.h"

/* Work budget of a pair. Boxes inspected: MOST_LOOKS, or fewer for large polygons, at least LEAST_LOOKS: ten seconds for a
 * million vertices. Positions computed to prove contact, by look. Boxes kept. Smaller: ends are looser. */
enum { MOST_LOOKS = 800, LEAST_LOOKS = 24, PLACES_PER_LOOK = 16, BOXES = 96 };
/* Edges of each polygon whose normals cut, by their number times that of all vertices; more are skipped evenly. The axes
 * between nearest points, of which the last AXES are kept, replace them. Fewer: more boxes. */
enum { EDGE_STEPS = 65536, MOST_EDGES = 64, LEAST_EDGES = 4, AXES = 12 };
/* Steps to the border between a contact and a point that is none. Fewer: less is proven from inside. */
enum { ROOT_STEPS = 40 };
/* Boxes that hardly lower their bound although smaller ones would not help. */
enum { MOST_STALLS = 24 };
/* Ends are found to AIM_S; boxes are not halved below SHORTEST_S. Below KNOWN_SHARE of what distances leave open the bend
 * of motion does not matter, and nearer than FEW times that to the border no more is known. A box shrinks if to SHRUNK of
 * its size, or if its bound comes nearer to what was seen by GAIN. */
static const double AIM_S = 5e-7, SHORTEST_S = 1e-7, KNOWN_SHARE = 0.1, FEW = 4.0, SHRUNK = 0.6, GAIN = 0.1;
/* Clearances below this are contact, beyond what a detection rounds by, metres. */
static const double SURE_M = -2.0 * KERNEL_TOUCH_M;
/* The root is near enough if it is this deep in contact, metres, or this near, seconds. */
static const double ROOT_M = 1e-7, ROOT_S = 1e-9;
/* Corners of a part are rounded by less than this share. */
static const double CORNER_SHARE = 1e-12;
/* A box of both times, the part of it in which contact is possible, and a bound on what is sought there. */
typedef struct {
    double u0, u1, v0, v1, bound;
    Part part;
} Box;

/* The largest value that was seen in contact, and where; -INFINITY for none. */
typedef struct {
    double value;
    Times at;
} Seen;

/* halves: of the vertices of a0, a1, b0 and b1. touch_m: by how much a detection may understate a distance. a_step,
 * b_step: one edge in this many cuts. */
typedef struct {
    Shift shift;
    Box *boxes;
    double *halves[4], touch_m;
    bool is_long;
    int64_t a_step, b_step;
    Vector axes[AXES];
    int axis_count, looks_left, stalls;
} Search;

/* How far vertices leave their chords; the rounding error bound; how much the reach may be overstated: plane metres. */
typedef struct {
    double bend_a, bend_b, touch, unknown;
} Slack;

static void put_halves(const Search *search, const Polygon *polygon, double *halves) {
    Vector origin = search->shift.pair->a.origin;
    for (int64_t i = 0; i < polygon->count; i++) {
        Vector there = {polygon->x[i] + origin.x, polygon->y[i] + origin.y};
        halves[i] = plane_half_m(search->shift.pair->plane, search->shift.reach_m, there, search->is_long);
    }
}

/* Compute the polygons at the ends of a box, and their halves. */
static Slack put_ends(Search *search, const Box *box) {
    Encounter *pair = search->shift.pair;
    Polygon *polygons[4] = {&pair->a0, &pair->a1, &pair->b0, &pair->b1};
    Extent extent = extent_none();
    mover_place(&pair->a, box->u0, &pair->a0), mover_place(&pair->a, box->u1, &pair->a1);
    mover_place(&pair->b, box->v0, &pair->b0), mover_place(&pair->b, box->v1, &pair->b1);
    for (int k = 0; k < 4; k++) extent_add(&extent, polygons[k], pair->a.origin);
    double largest = plane_largest_scale(pair->plane, &extent), hu = box->u1 - box->u0, hv = box->v1 - box->v0;
    Slack slack = {mover_bounds(&pair->a, box->u0, box->u1).acceleration * hu * hu / 8.0,
                   mover_bounds(&pair->b, box->v0, box->v1).acceleration * hv * hv / 8.0, search->touch_m * largest, 0.0};
    slack.unknown = slack.touch;
    if (search->shift.reach_m == 0.0) return slack;
    search->is_long = plane_half_is_long(pair->plane, search->shift.reach_m, largest);
    for (int k = 0; k < 4; k++) put_halves(search, polygons[k], search->halves[k]);
    /* Off its chord, a vertex changes its half by at most this share of how far it is off. */
    double share = 1.0 + plane_span_m(pair->plane, search->shift.reach_m, largest) * plane_christoffel(pair->plane, largest);
    slack.bend_a *= share, slack.bend_b *= share;
    slack.unknown += plane_half_error_m(pair->plane, search->shift.reach_m, largest);
    return slack;
}

static double half_at(const Search *search, Vector axis, const Polygon *polygon, const double *halves, int64_t i) {
    Vector there = {polygon->x[i] + search->shift.pair->a.origin.x, polygon->y[i] + search->shift.pair->a.origin.y};
    return plane_half_along(search->shift.pair->plane, halves[i], there, axis, search->is_long);
}

/* The farthest that the vertices of polygon k of the ends reach along a unit vector, their halves included. */
static double reaches(const Search *search, Vector axis, const Polygon *polygon, int k) {
    if (search->shift.reach_m == 0.0) return most_along(axis.x, axis.y, polygon);
    double found = -INFINITY;
    for (int64_t i = 0; i < polygon->count; i++) {
        double along = axis.x * polygon->x[i] + axis.y * polygon->y[i];
        found = most(found, along + half_at(search, axis, polygon, search->halves[k], i));
    }
    return found;
}

/* Cut off the part of a box that is apart along a unit vector. */
static void cut_along(Search *search, Box *box, Slack slack, Vector axis) {
    Encounter *pair = search->shift.pair;
    Vector back = {-axis.x, -axis.y};
    double a0 = reaches(search, axis, &pair->a0, 0), a1 = reaches(search, axis, &pair->a1, 1);
    double b0 = -reaches(search, back, &pair->b0, 2), b1 = -reaches(search, back, &pair->b1, 3);
    double level = slack.bend_a + slack.bend_b + slack.touch;
    if (!(most(b0, b1) - least(a0, a1) > level)) return;
    double hu = box->u1 - box->u0, hv = box->v1 - box->v0;
    double ru = hu > 0.0 ? -(a1 - a0) / hu : 0.0, rv = hv > 0.0 ? (b1 - b0) / hv : 0.0;
    part_cut(&box->part, ru, rv, b0 - a0 - ru * box->u0 - rv * box->v0 - level);
}

/* Cut by normals of edges in the middle of the box, each turned so that both ends of the edge reach as far with their
 * halves; sign: 1 for a, -1 for b. k: of the polygon among the ends. */
static void cut_edges(Search *search, Box *box, Slack slack, const Polygon *at0, const Polygon *at1, int k, double sign,
                      int64_t step) {
    for (int64_t i = 0; i < at0->count && at0->count > 1 && box->part.count > 0; i += step) {
        int64_t j = edge_end(at0, i);
        double x = 0.5 * ((at0->x[j] + at1->x[j]) - (at0->x[i] + at1->x[i]));
        double y = 0.5 * ((at0->y[j] + at1->y[j]) - (at0->y[i] + at1->y[i])), side = sqrt(x * x + y * y);
        if (!(side > 0.0)) continue;
        Vector axis = {sign * y / side, -sign * x / side};
        if (search->shift.reach_m > 0.0) {
            double one = half_at(search, axis, at0, search->halves[k], i);
            double turn = (one - half_at(search, axis, at0, search->halves[k], j)) / side;
            axis.x += sign * turn * x / side, axis.y += sign * turn * y / side;
            double length = norm(axis);
            axis.x /= length, axis.y /= length;
        }
        cut_along(search, box, slack, axis);
    }
}

static void cut_all(Search *search, Box *box, Slack slack) {
    Encounter *pair = search->shift.pair;
    cut_edges(search, box, slack, &pair->a0, &pair->a1, 0, 1.0, search->a_step);
    cut_edges(search, box, slack, &pair->b0, &pair->b1, 2, -1.0, search->b_step);
    for (int k = 0; k < least(search->axis_count, AXES) && box->part.count > 0; k++)
        cut_along(search, box, slack, search->axes[k]);
}

/* Cut along a new axis, and keep it for later boxes in place of the oldest. */
static void cut_axis(Search *search, Box *box, Slack slack, Vector axis) {
    if (!(fabs(axis.x) <= 1.0 && fabs(axis.y) <= 1.0)) return;
    search->axes[search->axis_count++ % AXES] = axis;
    cut_along(search, box, slack, axis);
}

/* Keep what is larger than the value seen. */
static void cut_seen(Box *box, double sign, const Seen *seen) {
    if (isfinite(seen->value)) part_cut(&box->part, sign, -sign, seen->value);
}

/* Shrink a box to its part. */
static void fit(Box *box) {
    double u0 = INFINITY, u1 = -INFINITY, v0 = INFINITY, v1 = -INFINITY;
    for (int i = 0; i < box->part.count; i++) {
        u0 = least(u0, box->part.corner[i].u), u1 = most(u1, box->part.corner[i].u);
        v0 = least(v0, box->part.corner[i].v), v1 = most(v1, box->part.corner[i].v);
    }
    double du = CORNER_SHARE * most(fabs(u0), fabs(u1)), dv = CORNER_SHARE * most(fabs(v0), fabs(v1));
    box->u0 = most(box->u0, u0 - du), box->u1 = least(box->u1, u1 + du);
    box->v0 = most(box->v0, v0 - dv), box->v1 = least(box->v1, v1 + dv);
}

static void see(Seen *seen, double sign, Times at) {
    double value = sign * (at.v - at.u);
    if (value > seen->value) *seen = (Seen){value, at};
}

/* The last contact on the way from a contact `in` to the tip of a part, which is none, by false position (Illinois: M.
 * Dowell, P. Jarratt, BIT 11 (1971), doi:10.1007/BF01934364). It is near enough if the box would not shrink much more. */
static Times border_point(Search *search, double sign, Times in, double f_in, Times tip, double f_tip) {
    double low = 0.0, high = 1.0, f_low = f_in - SURE_M, f_high = f_tip - SURE_M;
    double length = fabs(tip.u - in.u) + fabs(tip.v - in.v);
    bool is_rising = sign * (tip.v - tip.u) > sign * (in.v - in.u);
    int side = 0;
    for (int k = 0; k < ROOT_STEPS && (high - low) * length > ROOT_S; k++) {
        if (is_rising && high - low <= GAIN * (1.0 - high)) break;
        double s = low + (high - low) * (f_low / (f_low - f_high));
        if (!(s > low && s < high) || k % 8 == 7) s = 0.5 * (low + high);
        Times at = {in.u + s * (tip.u - in.u), in.v + s * (tip.v - in.v)};
        double f = shift_clearance_m(&search->shift, at, NULL) - SURE_M;
        if (f <= 0.0) {
            low = s, f_low = f;
            if (side == -1) f_high *= 0.5;
            side = -1;
            if (f > -ROOT_M) break;
        } else {
            high = s, f_high = f;
            if (side == 1) f_low *= 0.5;
            side = 1;
        }
    }
    return (Times){in.u + low * (tip.u - in.u), in.v + low * (tip.v - in.v)};
}

/* What becomes of a box that was inspected. */
typedef enum { IS_DONE, IS_SMALLER, IS_HALVED } Next;

/* Lower the bound of a box, and raise the value seen. IS_HALVED: by u or by v, as `by_u` says. */
static Next look(Search *search, Box *box, double sign, Seen *seen, bool *by_u) {
    Times tip;
    Vector axis;
    search->looks_left--, search->shift.pair->work->windows++;
    cut_seen(box, sign, seen);
    if (box->part.count > 0) fit(box);
    Slack slack = put_ends(search, box);
    cut_all(search, box, slack);
    box->bound = part_highest(&box->part, sign, &tip);
    if (box->bound <= seen->value + AIM_S) return IS_DONE;
    double before = box->bound, at_tip = shift_clearance_m(&search->shift, tip, &axis);
    if (at_tip <= SURE_M) {
        see(seen, sign, tip);
        return IS_DONE;
    }
    Times middle = part_middle(&box->part);
    cut_axis(search, box, slack, axis);
    double at_middle = shift_clearance_m(&search->shift, middle, &axis);
    if (at_middle <= SURE_M) see(seen, sign, border_point(search, sign, middle, at_middle, tip, at_tip));
    else cut_axis(search, box, slack, axis);
    cut_seen(box, sign, seen);
    box->bound = part_highest(&box->part, sign, &tip);
    if (box->part.count == 0) return IS_DONE;
    double hu = box->u1 - box->u0, hv = box->v1 - box->v0;
    fit(box);
    double nu = box->u1 - box->u0, nv = box->v1 - box->v0;
    bool is_bent = slack.bend_a + slack.bend_b > KNOWN_SHARE * slack.unknown;
    bool is_lower = before - box->bound > GAIN * (before - seen->value);
    search->stalls += !is_bent && !is_lower;
    if (nu <= SHORTEST_S && nv <= SHORTEST_S) return IS_DONE;
    if (!is_bent && (at_tip <= FEW * slack.unknown || search->stalls > MOST_STALLS)) return IS_DONE;
    if ((nu <= SHRUNK * hu + SHORTEST_S && nv <= SHRUNK * hv + SHORTEST_S) || (is_lower && !is_bent)) return IS_SMALLER;
    /* Halve the time during which vertices leave their chords more. */
    double of_u = hu > 0.0 ? slack.bend_a * nu * nu / (hu * hu) : 0.0,
           of_v = hv > 0.0 ? slack.bend_b * nv * nv / (hv * hv) : 0.0;
    *by_u = of_u == of_v ? nu >= nv : of_u > of_v;
    return IS_HALVED;
}

static Box half_of(const Box *box, double sign, bool by_u, bool is_first) {
    Box half = *box;
    Times at;
    double middle = by_u ? 0.5 * (box->u0 + box->u1) : 0.5 * (box->v0 + box->v1), side = is_first ? 1.0 : -1.0;
    part_cut(&half.part, by_u ? side : 0.0, by_u ? 0.0 : side, -side * middle);
    if (is_first) *(by_u ? &half.u1 : &half.v1) = middle;
    else *(by_u ? &half.u0 : &half.v0) = middle;
    half.bound = part_highest(&half.part, sign, &at);
    return half;
}

/* The largest sign (v - u) in contact within a box is at most the result; -INFINITY: there is no contact. */
static double highest(Search *search, const Box *whole, double sign, Seen *seen) {
    Box *boxes = search->boxes;
    Times at;
    bool by_u = false;
    double found = -INFINITY;
    int count = 1;
    search->stalls = 0;
    boxes[0] = *whole, boxes[0].bound = part_highest(&whole->part, sign, &at);
    while (count > 0) {
        int next = 0;
        for (int k = 1; k < count; k++)
            if (boxes[k].bound > boxes[next].bound) next = k;
        Box box = boxes[next];
        boxes[next] = boxes[--count];
        bool is_enough = box.bound <= seen->value + AIM_S || search->looks_left <= 0 || count + 2 > BOXES;
        Next then = is_enough ? IS_DONE : look(search, &box, sign, seen, &by_u);
        if (then == IS_DONE) found = most(found, box.bound);
        else if (then == IS_SMALLER) boxes[count++] = box;
        else {
            for (int k = 0; k < 2; k++) {
                boxes[count] = half_of(&box, sign, by_u, k == 0);
                count += boxes[count].part.count > 0;
            }
        }
    }
    return most(found, seen->value);
}

static const KernelDifference APART = {INFINITY, INFINITY, -INFINITY, -INFINITY, KERNEL_DIFFERENCE_NONE};

/* The differences of a pair that is set up, within its box. */
static KernelDifference differences_of(Search *search, Box *whole) {
    Encounter *pair = search->shift.pair;
    mover_focus(&pair->a, whole->u0, whole->u1), mover_focus(&pair->b, whole->v0, whole->v1);
    cut_all(search, whole, put_ends(search, whole));
    if (whole->part.count == 0) return APART;
    Seen last = {-INFINITY, {0.0, 0.0}}, first = last;
    int half = search->looks_left / 2;
    search->looks_left -= half;
    double high = highest(search, whole, 1.0, &last);
    if (high == -INFINITY) return APART;
    search->looks_left += half;
    if (isfinite(last.value)) see(&first, -1.0, last.at);
    double low = highest(search, whole, -1.0, &first);
    if (low == -INFINITY) return APART;
    KernelDifference found = {-low, INFINITY, -INFINITY, high, KERNEL_DIFFERENCE_OUTER};
    if (isfinite(last.value) && shift_contact_lasts(&search->shift, &first.at, &last.at, part_middle(&whole->part))) {
        found.state = KERNEL_DIFFERENCE_INNER;
        found.inner_low_s = first.at.v - first.at.u, found.inner_high_s = last.at.v - last.at.u;
    }
    return found;
}

/* Return the step between the edges of a polygon that cut; vertices: of the pair. */
static int64_t edge_step(int64_t edges, int64_t vertices) {
    int64_t some = EDGE_STEPS / (vertices > 0 ? vertices : 1);
    some = some < LEAST_EDGES ? LEAST_EDGES : some > MOST_EDGES ? MOST_EDGES : some;
    return edges > some ? (edges + some - 1) / some : 1;
}

/* Set up pair i; false if its times or one of its pieces is invalid. */
static bool begin(const KernelScene *scene, const KernelShifts *shifts, int64_t i, Search *search, Box *whole) {
    Encounter *pair = search->shift.pair;
    double u0 = shifts->a_start_s[i], u1 = shifts->a_end_s[i], v0 = shifts->b_start_s[i], v1 = shifts->b_end_s[i];
    Vector origin = scene->bodies[shifts->a[i]].origin;
    if (!(u0 <= u1 && v0 <= v1)) return false;
    if (!border_move(scene, shifts->a[i], shifts->a_zero_us[i], u0, u1, origin, &pair->a)) return false;
    if (!border_move(scene, shifts->b[i], shifts->b_zero_us[i], v0, v1, origin, &pair->b)) return false;
    *whole = (Box){.u0 = u0, .u1 = u1, .v0 = v0, .v1 = v1, .part = part_of(u0, u1, v0, v1)};
    int64_t n = pair->a.body->count, m = pair->b.body->count, looks = (int64_t)MOST_LOOKS * MOST_EDGES / (n + m);
    search->a_step = edge_step(n, n + m), search->b_step = edge_step(m, n + m);
    search->looks_left = (int)(looks > MOST_LOOKS ? MOST_LOOKS : looks < LEAST_LOOKS ? LEAST_LOOKS : looks);
    search->shift.evaluations_left = (int64_t)PLACES_PER_LOOK * search->looks_left;
    search->shift.u0 = u0, search->shift.u1 = u1, search->shift.v0 = v0, search->shift.v1 = v1;
    search->axis_count = 0;
    return true;
}

KernelStatus kernel_differences(const KernelScene *scene, const KernelShifts *shifts, double reach_m, KernelDifference *found,
                                KernelWork *work) {
    if (!scene || !shifts || !work) return KERNEL_NULL;
    if (shifts->count > 0 && (!shifts->b_zero_us || !shifts->b_start_s || !shifts->b_end_s || !found)) return KERNEL_NULL;
    KernelPairs pairs = {shifts->count, shifts->a, shifts->b, shifts->a_zero_us, shifts->a_start_s, shifts->a_end_s};
    Encounter pair = {.separation_m = reach_m, .work = work};
    double *memory;
    *work = (KernelWork){0};
    KernelStatus status = border_begin(scene, &pairs, &pair, &memory);
    if (status != KERNEL_OK) return status;
    int64_t largest = pair.a0.y - pair.a0.x;
    Box *boxes = malloc(BOXES * sizeof *boxes);
    double *halves = malloc(4 * (size_t)largest * sizeof *halves);
    Search search = {.shift = {.pair = &pair, .reach_m = reach_m}, .boxes = boxes};
    for (int k = 0; halves && k < 4; k++) search.halves[k] = halves + k * largest;
    search.touch_m = 2.0 * KERNEL_TOUCH_M + encounter_distance_error_m(&pair, reach_m);
    for (int64_t i = 0; boxes && halves && i < shifts->count; i++) {
        Box whole;
        double low = shifts->b_start_s[i] - shifts->a_end_s[i], high = shifts->b_end_s[i] - shifts->a_start_s[i];
        KernelDifference unknown = {low, INFINITY, -INFINITY, high, KERNEL_DIFFERENCE_UNKNOWN};
        if (!(low <= high)) unknown.outer_low_s = -INFINITY, unknown.outer_high_s = INFINITY;
        found[i] = begin(scene, shifts, i, &search, &whole) ? differences_of(&search, &whole) : unknown;
    }
    free(memory), free(boxes), free(halves);
    return boxes && halves ? KERNEL_OK : KERNEL_NO_MEMORY;
}
