/* Clearances of a shift, and proofs from inside: that contact lasts between two points of the contact set (differences.c).
 *
 * The separation of rigid polygons in uniform motion is convex in both times. So the straight way between two contacts is
 * in contact throughout, if it is so by more than their velocities and the earth's curvature can change. Where that way is
 * a border of the contact set, or the set is bent, it leads by way of the deepest point across its middle.
 */
#include "narrow/shift.h"

#include <stddef.h>

#include "geometry/runs.h"
#include "narrow/zone.h"

/* Halvings of a way, its parts, its parts before a way by other points is tried, the points by which it may lead, and the
 * steps towards such a point. Fewer: fewer proofs. */
enum { MOST_HALVINGS = 20, MOST_WAY_PARTS = 2000, FEW_WAY_PARTS = 50, MOST_BENDS = 5, DEEPEST_STEPS = 60 };
/* A point is deep enough if its neighbours are not deeper by more than this share. */
static const double DEEP_SHARE = 0.05;

static void place(Shift *shift, Times at) {
    Encounter *pair = shift->pair;
    pair->work->evaluations++, shift->evaluations_left--;
    mover_place(&pair->a, at.u, &pair->a_now), mover_place(&pair->b, at.v, &pair->b_now);
    if (!pair->a.body->is_convex) polygon_hull(&pair->a_now, &pair->spare);
    if (!pair->b.body->is_convex) polygon_hull(&pair->b_now, &pair->spare);
    runs_make(&pair->a_now, &pair->b_now);
}

/* Polygons in the metric of a place of the gnomonic plane, where lengths are those on the earth: with A = 1 + |x|^2 / R^2,
 * steps along x shrink by A, and steps across it by its root. */
typedef struct {
    Vector along;
    double across, more; /* a step s becomes across s + more (s.along) along */
} Metric;

static Metric metric_at(const KernelPlane *plane, Vector place) {
    double length = norm(place), a = 1.0 + length * length / (plane->radius_m * plane->radius_m), root = sqrt(a);
    Vector along = length > 0.0 ? (Vector){place.x / length, place.y / length} : (Vector){1.0, 0.0};
    return (Metric){along, 1.0 / root, 1.0 / a - 1.0 / root};
}

static Vector in_metric(const Metric *metric, Vector step) {
    double along = metric->more * (step.x * metric->along.x + step.y * metric->along.y);
    return (Vector){metric->across * step.x + along * metric->along.x, metric->across * step.y + along * metric->along.y};
}

static Polygon polygon_in_metric(const Metric *metric, const Polygon *polygon, double *x, double *y) {
    Polygon made = {.x = x, .y = y, .count = polygon->count, .bends = polygon->bends};
    for (int64_t i = 0; i < polygon->count; i++) {
        Vector at = in_metric(metric, (Vector){polygon->x[i], polygon->y[i]});
        x[i] = at.x, y[i] = at.y;
    }
    return made;
}

/* The plane gap of the polygons at an instant, with an axis; and, if they are apart, two places nearest to each other on
 * the earth: to the square of the angle that the reach is seen at, relative to the reach, as is plane_half_m. Nearest in
 * the plane if it is conformal, else in the metric of these. */
static Gap nearest_places(Shift *shift, Vector *from, Vector *to) {
    Encounter *pair = shift->pair;
    Gap gap = polygon_distance(&pair->a_now, &pair->b_now, from, to);
    if (!(gap.gap > 0.0) || shift->reach_m == 0.0 || pair->plane->projection == KERNEL_MERCATOR) return gap;
    Vector origin = pair->a.origin, middle = {0.5 * (from->x + to->x) + origin.x, 0.5 * (from->y + to->y) + origin.y};
    Metric metric = metric_at(pair->plane, middle);
    Metric back = {metric.along, 1.0 / metric.across, 1.0 / (metric.across + metric.more) - 1.0 / metric.across};
    /* The spare polygon has room for both. */
    int64_t half = (pair->spare.y - pair->spare.x) / 2;
    Polygon a = polygon_in_metric(&metric, &pair->a_now, pair->spare.x, pair->spare.y);
    Polygon b = polygon_in_metric(&metric, &pair->b_now, pair->spare.x + half, pair->spare.y + half);
    runs_make(&a, &b);
    pair->a_now.is_in_runs = pair->b_now.is_in_runs = false; /* their bends were used */
    Gap near = polygon_distance(&a, &b, from, to);
    if (!(near.gap > 0.0)) return gap;
    *from = in_metric(&back, *from), *to = in_metric(&back, *to);
    /* Where the distance is even: normals are steps, seen through the metric again. */
    Vector axis = in_metric(&metric, near.axis);
    double length = norm(axis);
    gap.axis = (Vector){axis.x / length, axis.y / length};
    return gap;
}

double shift_clearance_m(Shift *shift, Times at, Nearest *nearest) {
    Encounter *pair = shift->pair;
    Vector from, to;
    place(shift, at);
    Gap gap = nearest_places(shift, &from, &to);
    if (nearest) *nearest = (Nearest){gap.gap, gap.axis, from, to};
    if (shift->reach_m == 0.0) return gap.gap;
    return (gap.gap > 0.0 ? plane_way_m(pair->plane, from, to, pair->a.origin) : gap.gap) - shift->reach_m;
}

static double least_of(const Times *ends, bool is_u) {
    return is_u ? least(ends[0].u, ends[1].u) : least(ends[0].v, ends[1].v);
}
static double most_of(const Times *ends, bool is_u) { return is_u ? most(ends[0].u, ends[1].u) : most(ends[0].v, ends[1].v); }

/* A contact on a way: an upper bound on the clearance from the reach, metres, negative; the plane gap; and two places that
 * are so near each other, if the polygons are apart. extent: of both polygons, if there is a reach. */
typedef struct {
    Times at;
    double clearance, gap;
    Vector from, to;
    Extent extent;
} Stop;

static Stop stop_at(Shift *shift, Times at) {
    Stop stop = {.at = at};
    place(shift, at);
    stop.gap = stop.clearance = nearest_places(shift, &stop.from, &stop.to).gap;
    if (shift->reach_m == 0.0) return stop;
    Encounter *pair = shift->pair;
    if (stop.gap > 0.0) stop.clearance = plane_way_m(pair->plane, stop.from, stop.to, pair->a.origin);
    stop.clearance -= shift->reach_m;
    stop.extent = extent_none();
    extent_add(&stop.extent, &pair->a_now, pair->a.origin), extent_add(&stop.extent, &pair->b_now, pair->a.origin);
    return stop;
}

/* Whether (1 - s) f + s g + s (1 - s) bend <= level for all s of [0, 1]. */
static bool is_below(double f, double g, double bend, double level) {
    return f <= level && g <= level && sqrt(level - f) + sqrt(level - g) >= (1.0 + 1e-9) * sqrt(bend);
}

/* Whether the pair is in contact on the straight way between two stops that are.
 *
 * Places of the polygons that move evenly from those of one stop to those of the other stay in the polygons, to 2 s (1 - s)
 * K L at a share s of the way, with K the spread of velocities and L the time. In the plane their gap is convex. On the
 * earth their distance exceeds its chord by at most A s (1 - s) / 2, A the bend of zone.c for places that move by `a` and
 * `b`. */
static bool is_contact_directly(Shift *shift, const Stop *p, const Stop *q) {
    Encounter *pair = shift->pair;
    Times ends[2] = {p->at, q->at};
    double u0 = least_of(ends, true), u1 = most_of(ends, true), v0 = least_of(ends, false), v1 = most_of(ends, false);
    double leaves =
        2.0 * (mover_bounds(&pair->a, u0, u1).spread * (u1 - u0) + mover_bounds(&pair->b, v0, v1).spread * (v1 - v0));
    if (shift->reach_m > 0.0) {
        const KernelPlane *plane = pair->plane;
        Extent extent = extent_of_both(&p->extent, &q->extent);
        Scales scales = plane_scales(plane, &extent);
        if (is_below(p->gap, q->gap, leaves, (shift->reach_m - KERNEL_TOUCH_M) * scales.smallest)) return true;
        if (!(p->gap > 0.0 && q->gap > 0.0) || !(shift->reach_m < FURTHEST_SHARE * plane->radius_m)) return false;
        double a = hypot(q->from.x - p->from.x, q->from.y - p->from.y), b = hypot(q->to.x - p->to.x, q->to.y - p->to.y);
        double radius_m = LEAST_RADIUS_SHARE * plane->radius_m, bend = tan(0.5 * shift->reach_m / radius_m) / radius_m;
        bend = (bend + plane_christoffel(plane, scales.largest)) * (a * a + b * b) / (scales.smallest * scales.smallest);
        leaves = leaves / scales.smallest + 0.5 * bend;
    }
    return is_below(p->clearance, q->clearance, leaves, -KERNEL_TOUCH_M);
}

/* Whether the pair is in contact on the whole way between two stops, which is halved where needed; reached: the farthest
 * stop from p up to which it is proven to be. */
static bool is_contact_on(Shift *shift, Stop p, Stop q, int most_parts, Stop *reached) {
    struct {
        Stop p, q;
        int halvings;
    } stack[MOST_HALVINGS + 2], part;
    int top = 0, parts = 0;
    *reached = p;
    if (!(p.clearance <= -KERNEL_TOUCH_M && q.clearance <= -KERNEL_TOUCH_M)) return false;
    stack[top].p = p, stack[top].q = q, stack[top++].halvings = 0;
    while (top > 0) {
        part = stack[--top];
        if (is_contact_directly(shift, &part.p, &part.q)) {
            *reached = part.q;
            continue;
        }
        if (part.halvings >= MOST_HALVINGS || ++parts > most_parts || shift->evaluations_left <= 0) return false;
        Times middle = {0.5 * (part.p.at.u + part.q.at.u), 0.5 * (part.p.at.v + part.q.at.v)};
        Stop stop = stop_at(shift, middle);
        if (!(stop.clearance <= -KERNEL_TOUCH_M)) return false;
        stack[top].p = stop, stack[top].q = part.q, stack[top++].halvings = part.halvings + 1;
        stack[top].p = part.p, stack[top].q = stop, stack[top++].halvings = part.halvings + 1;
    }
    return true;
}

/* The deepest point across the middle of a way, within the box, by golden section search. */
static Times deepest_across(Shift *shift, Times p, Times q) {
    static const double GOLDEN = 0x1.3c6ef372fe95p-1;
    Times middle = {0.5 * (p.u + q.u), 0.5 * (p.v + q.v)}, across = {q.v - p.v, q.u - p.u};
    across.u = -across.u;
    if (across.u == 0.0 && across.v == 0.0) across.u = 1.0;
    double low = -INFINITY, high = INFINITY;
    double ends[2][2] = {{shift->u0 - middle.u, shift->u1 - middle.u}, {shift->v0 - middle.v, shift->v1 - middle.v}};
    for (int k = 0; k < 2; k++) {
        double step = k == 0 ? across.u : across.v;
        if (step == 0.0) continue;
        low = most(low, least(ends[k][0] / step, ends[k][1] / step));
        high = least(high, most(ends[k][0] / step, ends[k][1] / step));
    }
    double x = high - GOLDEN * (high - low), y = low + GOLDEN * (high - low);
    double fx = shift_clearance_m(shift, (Times){middle.u + x * across.u, middle.v + x * across.v}, NULL);
    double fy = shift_clearance_m(shift, (Times){middle.u + y * across.u, middle.v + y * across.v}, NULL);
    for (int k = 0; k < DEEPEST_STEPS && !(most(fx, fy) < 0.0 && fabs(fx - fy) <= DEEP_SHARE * -least(fx, fy)); k++) {
        if (fx <= fy) {
            high = y, y = x, fy = fx, x = high - GOLDEN * (high - low);
            fx = shift_clearance_m(shift, (Times){middle.u + x * across.u, middle.v + x * across.v}, NULL);
        } else {
            low = x, x = y, fx = fy, y = low + GOLDEN * (high - low);
            fy = shift_clearance_m(shift, (Times){middle.u + y * across.u, middle.v + y * across.v}, NULL);
        }
    }
    double at = fx <= fy ? x : y;
    Times found = {middle.u + at * across.u, middle.v + at * across.v};
    found.u = most(shift->u0, least(shift->u1, found.u)), found.v = most(shift->v0, least(shift->v1, found.v));
    return found;
}

/* Whether each difference between those of two contacts is one of contact: on the straight way, or by way of points inside
 * where that is a border of the contact set, or the set is bent. */
static bool is_contact_between(Shift *shift, Stop p, Stop q, Times middle, int bends) {
    Stop reached;
    if (is_contact_on(shift, p, q, bends == 0 ? MOST_WAY_PARTS : FEW_WAY_PARTS, &reached)) return true;
    if (bends == 0 || shift->evaluations_left <= 0) return false;
    Stop m = stop_at(shift, middle);
    if (bends == MOST_BENDS && is_contact_on(shift, p, m, FEW_WAY_PARTS, &reached) &&
        is_contact_on(shift, m, q, FEW_WAY_PARTS, &reached))
        return true;
    m = stop_at(shift, deepest_across(shift, p.at, q.at));
    if (!(m.clearance <= -KERNEL_TOUCH_M)) return false;
    return is_contact_between(shift, p, m, middle, bends - 1) && is_contact_between(shift, m, q, middle, bends - 1);
}

bool shift_contact_lasts(Shift *shift, Times *from, Times *to, Times middle) {
    Stop p = stop_at(shift, *from), q = stop_at(shift, *to);
    shift->evaluations_left /= 2;
    int64_t more = shift->evaluations_left;
    if (is_contact_between(shift, p, q, middle, MOST_BENDS)) return true;
    /* From a deep point towards both ends, as far as that goes. */
    shift->evaluations_left += more;
    Stop m = stop_at(shift, deepest_across(shift, *from, *to)), first, last;
    if (!(m.clearance <= -KERNEL_TOUCH_M)) m = stop_at(shift, middle);
    if (!(m.clearance <= -KERNEL_TOUCH_M)) m = q;
    is_contact_on(shift, m, p, MOST_WAY_PARTS, &first);
    is_contact_on(shift, m, q, MOST_WAY_PARTS, &last);
    double low = goal_value(&shift->goal, 1.0, *from), high = goal_value(&shift->goal, 1.0, *to);
    double begins = goal_value(&shift->goal, 1.0, first.at), ends = goal_value(&shift->goal, 1.0, last.at);
    *from = first.at, *to = last.at;
    /* Around the earth polygons may meet at other differences: such contacts are other pairs'. */
    return m.clearance <= -KERNEL_TOUCH_M && low <= begins && begins <= ends && ends <= high;
}
