/* Proofs in the zone: closing in (the distance changes in one direction only), apart, and near. Closing in is cheap to
 * prove for polygons that meet at a speed.
 *
 * Apart: the distance is at least its chord, minus its largest upward bend (approach_bounds.c).
 *
 * Near: the distance is at most that of two places, one moving with each polygon. Let theta be the angle between them,
 * u and w their speeds on the earth, a1 and a2 their accelerations. The second variation of arc length is smallest for
 * a Jacobi field, so for curvature of at most K their distance d has
 *
 *     d'' >= -sqrt(K) (u^2 + w^2) tan(sqrt(K) d / 2) - a1 - a2 = -A.
 *
 * Between two instants h seconds apart it exceeds its chord by at most A s (1 - s) h^2 / 2 at a fraction s of the time.
 * It stays below the separation if it is below it at the first instant, and by A h^2 / 2 at the second.
 *
 * Reference: M. do Carmo, "Riemannian Geometry" (1992), chapters 9 and 10 (the index lemma).
 */
#include "narrow/zone.h"

#include "narrow/approach.h"

/* Times inspected per proof, usually one or two. Smaller: more pairs are searched. */
enum { MAX_PARTS = 24 };
static const double HALF_PI = 0x1.921fb54442d18p0;

/* Let p and q be nearest on the earth at some instant. They are at most as far apart as the nearest places in the plane
 * then, and so in the plane at most `ratio` times the smallest distance at the end: their direction is within acos(1 /
 * ratio) of its axis n, and the direction in which their distance shrinks is within the plane's slant of that. With s
 * the sum of both angles, they close in at |n.V| cos s - |V across| sin s or faster, V the relative velocity, minus the
 * spread K of both and minus the change of the scale along the line. */
bool zone_closes_in(Encounter *pair, double limit, double end, Scales scales) {
    double first = least(limit, end), last = most(limit, end), length = last - first, middle = 0.5 * (first + last);
    Vector va = mover_velocity(&pair->a, middle), vb = mover_velocity(&pair->b, middle);
    Vector v = {vb.x - va.x, vb.y - va.y};
    double spread = encounter_bounds(pair, first, last).spread, at_limit = encounter_plane_distance(pair, limit).gap;
    Gap at_end = encounter_plane_distance(pair, end);
    if (!(at_end.gap > 0.0)) return false;
    double closing = (limit < end ? -1.0 : 1.0) * (at_end.axis.x * v.x + at_end.axis.y * v.y);
    double across = fabs(at_end.axis.x * v.y - at_end.axis.y * v.x), speed = most(norm(va), norm(vb)) + spread;
    /* The nearest places, in the plane or on the earth, lie where each polygon is within reach of the other. */
    double furthest = most(at_limit, at_end.gap) + 2.0 * spread * length;
    Scales near = encounter_scales_within(pair, plane_span_m(pair->plane, furthest / scales.smallest, scales.largest));
    double furthest_m = furthest / near.smallest, turned = norm(v) * spread * length / at_end.gap;
    double ratio = plane_span_m(pair->plane, furthest_m, near.largest) / at_end.gap;
    double aside = acos(least(1.0 / ratio, 1.0)) + plane_slant(pair->plane, furthest_m, near.largest);
    double slowest = closing * cos(aside) - across * sin(aside);
    double drift = 2.0 * plane_drift(pair->plane, furthest_m, near.largest, speed);
    return aside < HALF_PI && slowest > spread + drift + turned;
}

bool zone_is_apart(Encounter *pair, double from, double to) {
    struct {
        double start, end, first, last;
    } stack[MAX_PARTS + 1], part;
    int top = 0, parts = 0;
    double start = least(from, to), end = most(from, to), wanted_m = pair->separation_m;
    if (start == end) return true;
    stack[top].start = start, stack[top].end = end;
    stack[top].first = approach_distance(pair, start), stack[top++].last = approach_distance(pair, end);
    while (top > 0) {
        part = stack[--top];
        During during = approach_during(pair, part.start, part.end, part.first, part.last, wanted_m);
        if (during.bound >= wanted_m) continue;
        if (++parts > MAX_PARTS || top + 2 > MAX_PARTS || !(during.middle > wanted_m)) return false;
        double middle = 0.5 * (part.start + part.end);
        stack[top].start = part.start, stack[top].end = middle;
        stack[top].first = part.first, stack[top++].last = during.middle;
        stack[top].start = middle, stack[top].end = part.end;
        stack[top].first = during.middle, stack[top++].last = part.last;
    }
    return true;
}

/* A place on a side of a polygon, as a fraction of the way from vertex `side` to the next. */
typedef struct {
    int64_t side;
    double share;
} Place;

static Place place_of(const Polygon *polygon, Vector point) {
    Place found = {0, 0.0};
    double nearest = INFINITY;
    for (int64_t k = 0; k < polygon->count; k++) {
        int64_t m = edge_end(polygon, k);
        Vector way = {point.x - polygon->x[k], point.y - polygon->y[k]};
        Vector side = {polygon->x[m] - polygon->x[k], polygon->y[m] - polygon->y[k]};
        double square = squared_distance(way, side), length2 = side.x * side.x + side.y * side.y;
        if (!(square < nearest)) continue;
        nearest = square, found.side = k;
        found.share = length2 > 0.0 ? most(0.0, least((way.x * side.x + way.y * side.y) / length2, 1.0)) : 0.0;
    }
    return found;
}

static Vector point_at(const Polygon *polygon, Place place) {
    int64_t k = place.side, m = edge_end(polygon, k);
    return (Vector){polygon->x[k] + place.share * (polygon->x[m] - polygon->x[k]),
                    polygon->y[k] + place.share * (polygon->y[m] - polygon->y[k])};
}

/* A of the file's head, during a time in which places stay within distance_m of each other. */
static double downward(const Encounter *pair, double start, double end, const Extent *extent, double distance_m) {
    const KernelPlane *plane = pair->plane;
    Bounds a = mover_bounds(&pair->a, start, end), b = mover_bounds(&pair->b, start, end);
    double middle = 0.5 * (start + end), largest = plane_largest_scale(plane, extent);
    double smallest = plane_smallest_scale(plane, extent), radius_m = LEAST_RADIUS_SHARE * plane->radius_m;
    double u = (norm(mover_velocity(&pair->a, middle)) + a.spread) / smallest;
    double w = (norm(mover_velocity(&pair->b, middle)) + b.spread) / smallest, squares = u * u + w * w;
    double curving = tan(0.5 * distance_m / radius_m) / radius_m + plane_christoffel(plane, largest);
    return curving * squares + (a.acceleration + b.acceleration) / smallest;
}

bool zone_is_near(Encounter *pair, double from, double to) {
    const KernelPlane *plane = pair->plane;
    Vector origin = pair->a.origin, a, b;
    double wanted_m = pair->separation_m, now = from, step = to - from;
    if (!pair->a.body->is_convex || !pair->b.body->is_convex) return false;
    if (!(wanted_m < FURTHEST_SHARE * plane->radius_m)) return false;
    for (int parts = 0; now != to; parts++) {
        if (parts >= MAX_PARTS) return false;
        encounter_place(pair, now);
        plane_nearest(plane, &pair->a_now, &pair->b_now, origin, &a, &b, &pair->parts_left);
        Place on_a = place_of(&pair->a_now, a), on_b = place_of(&pair->b_now, b);
        if (!(plane_way_m(plane, point_at(&pair->a_now, on_a), point_at(&pair->b_now, on_b), origin) < wanted_m)) return false;
        /* Halve the step while it is too long for these places. */
        for (bool is_near = false; !is_near; parts++) {
            if (parts >= MAX_PARTS) return false;
            double then = fabs(to - now) <= fabs(step) ? to : now + step, h = fabs(then - now);
            pair->work->evaluations++;
            Extent extent = encounter_extent(pair, now, then);
            double way_m = plane_way_m(plane, point_at(&pair->a1, on_a), point_at(&pair->b1, on_b), origin);
            double bend = downward(pair, least(now, then), most(now, then), &extent, wanted_m);
            is_near = wanted_m - way_m > 0.5 * bend * h * h;
            if (is_near) now = then;
            else step *= 0.5;
        }
    }
    return true;
}
