#include "narrow/cuts.h"

#include "narrow/proofs.h"

/* Edges of each polygon whose normals cut, by their number times that of all vertices; more are skipped evenly. The axes
 * between nearest points replace them. Fewer: more boxes. */
enum { EDGE_STEPS = 65536, MOST_EDGES = 64, LEAST_EDGES = 4 };
/* The near part of a side is this many times as wide as the gaps in the part of a box differ. Smaller: the other pieces may not
 * be apart; larger: its ends' halves are too large. It is tried where vertices leave their chords by less than HALF_KNOWN
 * of a clearance. */
static const double NEAR_WIDTH = 1.5, HALF_KNOWN = 0.5;

static void put_halves(const Cuts *cuts, const Polygon *polygon, double *halves) {
    Vector origin = cuts->shift.pair->a.origin;
    for (int64_t i = 0; i < polygon->count; i++) {
        Vector there = {polygon->x[i] + origin.x, polygon->y[i] + origin.y};
        halves[i] = plane_half_m(cuts->shift.pair->plane, cuts->shift.reach_m, there, cuts->is_long);
    }
}

/* The speed of b relative to a in the middle of a box, plane m/s; of a stretched track at most. Where a distance is required, a
 * detection may keep what comes nearer to it than this takes it in half of its shortest interval. */
static double relative_speed(const Cuts *cuts, const Box *box) {
    const Encounter *pair = cuts->shift.pair;
    Vector a = mover_velocity(&pair->a, 0.5 * (box->u0 + box->u1)), b = mover_velocity(&pair->b, 0.5 * (box->v0 + box->v1));
    if (cuts->shift.goal.is_factor) return norm(a) / least(cuts->shift.goal.least, 1.0) + norm(b);
    return hypot(b.x - a.x, b.y - a.y);
}

Slack cuts_put_ends(Cuts *cuts, const Box *box) {
    Encounter *pair = cuts->shift.pair;
    Polygon *polygons[4] = {&pair->a0, &pair->a1, &pair->b0, &pair->b1};
    Extent extent = extent_none();
    mover_place(&pair->a, box->u0, &pair->a0), mover_place(&pair->a, box->u1, &pair->a1);
    mover_place(&pair->b, box->v0, &pair->b0), mover_place(&pair->b, box->v1, &pair->b1);
    for (int k = 0; k < 4; k++) extent_add(&extent, polygons[k], pair->a.origin);
    double largest = plane_largest_scale(pair->plane, &extent), hu = box->u1 - box->u0, hv = box->v1 - box->v0;
    Bounds a = mover_bounds(&pair->a, box->u0, box->u1), b = mover_bounds(&pair->b, box->v0, box->v1);
    Slack slack = {a.acceleration * hu * hu / 8.0, b.acceleration * hv * hv / 8.0, cuts->touch_m * largest, 0.0};
    slack.unknown = slack.touch;
    if (cuts->shift.reach_m == 0.0) return slack;
    slack.touch += 0.5 * SHORTEST_INTERVAL_S * (relative_speed(cuts, box) + a.spread + b.spread);
    slack.unknown = slack.touch;
    cuts->is_long = plane_half_is_long(pair->plane, cuts->shift.reach_m, largest);
    for (int k = 0; k < 4; k++) put_halves(cuts, polygons[k], cuts->halves[k]);
    /* Off its chord, a vertex changes its half by at most this share of how far it is off. */
    double share = 1.0 + plane_span_m(pair->plane, cuts->shift.reach_m, largest) * plane_christoffel(pair->plane, largest);
    slack.bend_a *= share, slack.bend_b *= share;
    slack.unknown += plane_half_error_m(pair->plane, cuts->shift.reach_m, largest);
    return slack;
}

static double half_at(const Cuts *cuts, Vector axis, const Polygon *polygon, const double *halves, int64_t i) {
    Vector there = {polygon->x[i] + cuts->shift.pair->a.origin.x, polygon->y[i] + cuts->shift.pair->a.origin.y};
    return plane_half_along(cuts->shift.pair->plane, halves[i], there, axis, cuts->is_long);
}

/* The farthest that the vertices of polygon k of the ends reach along a unit vector, their halves included. */
static double reaches(const Cuts *cuts, Vector axis, const Polygon *polygon, int k) {
    if (cuts->shift.reach_m == 0.0) return most_along(axis.x, axis.y, polygon);
    double found = -INFINITY;
    for (int64_t i = 0; i < polygon->count; i++) {
        double along = axis.x * polygon->x[i] + axis.y * polygon->y[i];
        found = most(found, along + half_at(cuts, axis, polygon, cuts->halves[k], i));
    }
    return found;
}

/* How far a reaches at u0 and u1 along a vector, and from where on b is at v0 and v1, their halves included. */
typedef struct {
    double a0, a1, b0, b1;
} Ends;

static Ends ends_along(const Cuts *cuts, Vector axis) {
    const Encounter *pair = cuts->shift.pair;
    Vector back = {-axis.x, -axis.y};
    return (Ends){reaches(cuts, axis, &pair->a0, 0), reaches(cuts, axis, &pair->a1, 1), -reaches(cuts, back, &pair->b0, 2),
                  -reaches(cuts, back, &pair->b1, 3)};
}

/* A lower bound on the gap: positive, the pair is apart. u + v plus `level`. */
typedef struct {
    double u, v, level;
} Affine;

static Affine gap_between(const Box *box, Slack slack, Ends ends) {
    double hu = box->u1 - box->u0, hv = box->v1 - box->v0;
    double u = hu > 0.0 ? -(ends.a1 - ends.a0) / hu : 0.0, v = hv > 0.0 ? (ends.b1 - ends.b0) / hv : 0.0;
    double first = ends.b0 - ends.a0 - slack.bend_a - slack.bend_b - slack.touch;
    return (Affine){u, v, first - u * box->u0 - v * box->v0};
}

/* Cut off the part of a box that is apart along a unit vector. */
static void cut_along(Cuts *cuts, Box *box, Slack slack, Vector axis) {
    Ends ends = ends_along(cuts, axis);
    if (!(most(ends.b0, ends.b1) - least(ends.a0, ends.a1) > slack.bend_a + slack.bend_b + slack.touch)) return;
    Affine gap = gap_between(box, slack, ends);
    part_cut(&box->part, gap.u, gap.v, gap.level);
}

/* Cut by normals of edges in the middle of the box, each turned so that both ends of the edge reach as far with their
 * halves; sign: 1 for a, -1 for b. k: of the polygon among the ends. */
static void cut_edges(Cuts *cuts, Box *box, Slack slack, const Polygon *at0, const Polygon *at1, int k, double sign,
                      int64_t step) {
    for (int64_t i = 0; i < at0->count && at0->count > 1 && box->part.count > 0; i += step) {
        int64_t j = edge_end(at0, i);
        double x = 0.5 * ((at0->x[j] + at1->x[j]) - (at0->x[i] + at1->x[i]));
        double y = 0.5 * ((at0->y[j] + at1->y[j]) - (at0->y[i] + at1->y[i])), side = sqrt(x * x + y * y);
        if (!(side > 0.0)) continue;
        Vector axis = {sign * y / side, -sign * x / side};
        if (cuts->shift.reach_m > 0.0) {
            double one = half_at(cuts, axis, at0, cuts->halves[k], i);
            double turn = (one - half_at(cuts, axis, at0, cuts->halves[k], j)) / side;
            axis.x += sign * turn * x / side, axis.y += sign * turn * y / side;
            double length = norm(axis);
            axis.x /= length, axis.y /= length;
        }
        cut_along(cuts, box, slack, axis);
    }
}

void cuts_by_all(Cuts *cuts, Box *box, Slack slack) {
    Encounter *pair = cuts->shift.pair;
    cut_edges(cuts, box, slack, &pair->a0, &pair->a1, 0, 1.0, cuts->a_step);
    cut_edges(cuts, box, slack, &pair->b0, &pair->b1, 2, -1.0, cuts->b_step);
    for (int k = 0; k < least(cuts->axis_count, AXES) && box->part.count > 0; k++) cut_along(cuts, box, slack, cuts->axes[k]);
}

/* A unit vector, turned by the angle of this tangent towards another one that is across it. */
static Vector turned(Vector axis, Vector along, double tangent) {
    Vector sum = {axis.x + tangent * along.x, axis.y + tangent * along.y};
    double length = norm(sum);
    return (Vector){sum.x / length, sum.y / length};
}

Passing cuts_by_passing(Cuts *cuts, Box *box, Slack slack, double sign) {
    Encounter *pair = cuts->shift.pair;
    Passing none = {.bound = INFINITY};
    double hu = box->u1 - box->u0, hv = box->v1 - box->v0;
    if (!(cuts->shift.reach_m > 0.0 && hu > 0.0 && hv > 0.0)) return none;
    Vector a = mover_velocity(&pair->a, 0.5 * (box->u0 + box->u1)), b = mover_velocity(&pair->b, 0.5 * (box->v0 + box->v1));
    /* Along v = factor u both times change together. */
    double factor = cuts->shift.goal.is_factor ? sign * box->bound : cuts->shift.goal.weight;
    Vector way = {factor * b.x - a.x, factor * b.y - a.y};
    double speed = norm(way);
    if (!(speed > 0.0)) return none;
    Vector along = {way.x / speed, way.y / speed}, axis = {-along.y, along.x};
    if (sign * (axis.x * a.x + axis.y * a.y) < 0.0) axis = (Vector){-axis.x, -axis.y};
    Affine gap = gap_between(box, slack, ends_along(cuts, axis));
    gap = gap_between(box, slack, ends_along(cuts, turned(axis, along, -(gap.u + factor * gap.v) / speed)));
    part_cut(&box->part, gap.u, gap.v, gap.level);
    double rate = 0.5 * sign * (gap.v - gap.u);
    if (!(rate > 0.0) || cuts->shift.goal.is_factor || cuts->shift.goal.weight != 1.0) return none;
    return (Passing){along, along.x * a.x + along.y * a.y, along.x * b.x + along.y * b.y, -gap.level / rate, rate};
}

void cuts_by_axis(Cuts *cuts, Box *box, Slack slack, Vector axis) {
    if (!(fabs(axis.x) <= 1.0 && fabs(axis.y) <= 1.0)) return;
    cuts->axes[cuts->axis_count++ % AXES] = axis;
    cut_along(cuts, box, slack, axis);
}

/* The side of a polygon that is nearest to a place, and the share of it there. */
static int64_t side_under(const Polygon *polygon, Vector place, double *share) {
    double nearest = INFINITY;
    int64_t found = 0;
    for (int64_t i = 0; i < polygon->count; i++) {
        int64_t j = edge_end(polygon, i);
        Vector way = {place.x - polygon->x[i], place.y - polygon->y[i]};
        Vector side = {polygon->x[j] - polygon->x[i], polygon->y[j] - polygon->y[i]};
        double square = squared_distance(way, side), length2 = side.x * side.x + side.y * side.y;
        if (!(square < nearest)) continue;
        nearest = square, found = i;
        *share = length2 > 0.0 ? least(most((way.x * side.x + way.y * side.y) / length2, 0.0), 1.0) : 0.0;
    }
    return found;
}

/* A part of a convex polygon: its vertices from `first` on, `count` of them, and those at two shares of a side, if in [0,
 * 1]. */
typedef struct {
    int64_t first, count, side;
    double shares[2];
} Piece;

static Vector on_side(const Polygon *polygon, int64_t side, double share) {
    int64_t end = edge_end(polygon, side);
    return (Vector){polygon->x[side] + share * (polygon->x[end] - polygon->x[side]),
                    polygon->y[side] + share * (polygon->y[end] - polygon->y[side])};
}

/* How far a place reaches along a unit vector, its half included. */
static double place_reaches(const Cuts *cuts, Vector axis, Vector place) {
    const KernelPlane *plane = cuts->shift.pair->plane;
    Vector there = {place.x + cuts->shift.pair->a.origin.x, place.y + cuts->shift.pair->a.origin.y};
    double half = plane_half_m(plane, cuts->shift.reach_m, there, cuts->is_long);
    return axis.x * place.x + axis.y * place.y + plane_half_along(plane, half, there, axis, cuts->is_long);
}

/* `reaches` of a piece of polygon k of the ends. */
static double piece_reaches(const Cuts *cuts, Vector axis, const Polygon *polygon, int k, const Piece *piece) {
    double found = -INFINITY;
    for (int64_t n = 0, i = piece->first; n < piece->count; n++, i = edge_end(polygon, i)) {
        double along = axis.x * polygon->x[i] + axis.y * polygon->y[i];
        found = most(found, along + half_at(cuts, axis, polygon, cuts->halves[k], i));
    }
    for (int n = 0; n < 2; n++)
        if (piece->shares[n] >= 0.0)
            found = most(found, place_reaches(cuts, axis, on_side(polygon, piece->side, piece->shares[n])));
    return found;
}

/* The gap along a vector if one polygon is but a piece of it. */
static Affine piece_gap(const Cuts *cuts, const Box *box, Slack slack, Vector axis, bool is_a, const Piece *piece) {
    const Encounter *pair = cuts->shift.pair;
    Ends ends = ends_along(cuts, axis);
    Vector back = {-axis.x, -axis.y};
    if (is_a) {
        ends.a0 = piece_reaches(cuts, axis, &pair->a0, 0, piece);
        ends.a1 = piece_reaches(cuts, axis, &pair->a1, 1, piece);
    } else {
        ends.b0 = -piece_reaches(cuts, back, &pair->b0, 2, piece);
        ends.b1 = -piece_reaches(cuts, back, &pair->b1, 3, piece);
    }
    return gap_between(box, slack, ends);
}

static double least_on(const Part *part, Affine gap) {
    double found = INFINITY;
    for (int i = 0; i < part->count; i++)
        found = least(found, gap.u * part->corner[i].u + gap.v * part->corner[i].v + gap.level);
    return found;
}

/* The normal of a side in the middle of the box, turned so that its places at two shares reach as far, halves included.
 * along: the direction of the side. */
static Vector even_normal(const Cuts *cuts, const Polygon *at0, const Polygon *at1, int64_t side, double from, double to,
                          double sign, Vector *along) {
    int64_t end = edge_end(at0, side);
    double x = 0.5 * ((at0->x[end] + at1->x[end]) - (at0->x[side] + at1->x[side]));
    double y = 0.5 * ((at0->y[end] + at1->y[end]) - (at0->y[side] + at1->y[side])), length = hypot(x, y);
    *along = (Vector){x / length, y / length};
    Vector outward = {along->y, -along->x};
    double more = place_reaches(cuts, outward, on_side(at0, side, from)) - place_reaches(cuts, outward, on_side(at0, side, to));
    Vector even = turned(outward, *along, more / ((to - from) * length));
    return (Vector){sign * even.x, sign * even.y};
}

/* Cut along the normal of the side that a place is on, by the part of the side near it.
 *
 * Halves are convex: within a side they are less than its ends have them, which matters for long sides. So the polygon is
 * divided into three convex pieces, at two places of the side and at the opposite vertex. If those with an end of the
 * side are apart everywhere in the part of the box, along normals turned away from them, contact is with the third.
 */
static void cut_near(Cuts *cuts, Box *box, Slack slack, bool is_a, Vector place, double gap) {
    const Encounter *pair = cuts->shift.pair;
    const Polygon *at0 = is_a ? &pair->a0 : &pair->b0, *at1 = is_a ? &pair->a1 : &pair->b1;
    double share, sign = is_a ? 1.0 : -1.0;
    Vector along;
    if (at0->count < 2 || !(is_a ? &pair->a : &pair->b)->body->is_convex) return;
    int64_t side = side_under(at0, place, &share), end = edge_end(at0, side), n = at0->count;
    double length = norm((Vector){at0->x[end] - at0->x[side], at0->y[end] - at0->y[side]});
    if (!(length > 0.0)) return;
    Piece whole = {side, n, side, {-1.0, -1.0}};
    Vector even = even_normal(cuts, at0, at1, side, 0.0, 1.0, sign, &along);
    /* The other pieces are farther than the gaps in the part differ. */
    double missing = most(-least_on(&box->part, piece_gap(cuts, box, slack, even, is_a, &whole)), 0.0);
    double width = NEAR_WIDTH * sqrt(2.0 * gap * missing) / length, low = share - width, high = share + width;
    if (!(width > 0.0) || (low <= 0.0 && high >= 1.0)) return;
    int64_t opposite = (side + 1 + n / 2) % n, after = n / 2 + (n > 2), before = n - after + (n > 2);
    Piece first = {n > 2 ? opposite : side, before, side, {low, -1.0}}, last = {end, after, side, {-1.0, high}};
    Piece near = {opposite, n > 2, side, {low, high}};
    if (low <= 0.0) near = first, near.shares[0] = -1.0, near.shares[1] = high;
    if (high >= 1.0) near = last, near.shares[0] = low, near.shares[1] = -1.0;
    even = even_normal(cuts, at0, at1, side, most(low, 0.0), least(high, 1.0), sign, &along);
    double away = sign * width * length / gap;
    Vector to_first = turned(even, along, away), to_last = turned(even, along, -away);
    if (low > 0.0 && !(least_on(&box->part, piece_gap(cuts, box, slack, to_first, is_a, &first)) > 0.0)) return;
    if (high < 1.0 && !(least_on(&box->part, piece_gap(cuts, box, slack, to_last, is_a, &last)) > 0.0)) return;
    Affine cut = piece_gap(cuts, box, slack, even, is_a, &near);
    part_cut(&box->part, cut.u, cut.v, cut.level);
}

void cuts_by_near_part(Cuts *cuts, Box *box, Slack slack, double sign, double at_tip, const Nearest *nearest) {
    Times tip;
    double of_a, of_b, bound = box->bound;
    if (cuts->shift.reach_m == 0.0 || slack.bend_a + slack.bend_b > HALF_KNOWN * at_tip) return;
    if (goal_highest(&cuts->shift.goal, &box->part, sign, &tip) < bound) return;
    side_under(&cuts->shift.pair->a0, nearest->from, &of_a), side_under(&cuts->shift.pair->b0, nearest->to, &of_b);
    bool is_a = least(of_a, 1.0 - of_a) > least(of_b, 1.0 - of_b);
    cut_near(cuts, box, slack, is_a, is_a ? nearest->from : nearest->to, nearest->gap);
}

/* Return the step between the edges of a polygon that cut; vertices: of the pair. */
static int64_t edge_step(int64_t edges, int64_t vertices) {
    int64_t some = EDGE_STEPS / (vertices > 0 ? vertices : 1);
    some = some < LEAST_EDGES ? LEAST_EDGES : some > MOST_EDGES ? MOST_EDGES : some;
    return edges > some ? (edges + some - 1) / some : 1;
}

void cuts_begin(Cuts *cuts) {
    int64_t n = cuts->shift.pair->a.body->count, m = cuts->shift.pair->b.body->count;
    cuts->a_step = edge_step(n, n + m), cuts->b_step = edge_step(m, n + m);
    cuts->axis_count = 0;
}
