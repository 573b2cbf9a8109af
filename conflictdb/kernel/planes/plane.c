#include "planes/plane.h"

#include <math.h>

/* Up to this many metres the scale is constant, to a relative 1e-8 at 89 degrees of latitude. */
static const double SHORT_M = 1e-3;
/* Rounding error bound of distances from gnomonic coordinates of up to 1.1e7 m, rounded by 2e-9 m each. */
static const double GNOMONIC_ROUNDING_M = 1e-8;
/* The nearest place on a side: compare EDGE_PLACES places, then golden section search about the best one, at most
 * EDGE_STEPS steps, which shrink 1,000 km to less than a micrometre, or until PLACE_M is reached. Fewer places: the
 * wrong one of two minima may be found. J. Kiefer, "Sequential minimax search for a maximum", Proc. AMS 4 (1953),
 * doi:10.1090/S0002-9939-1953-0055639-3. */
enum { EDGE_PLACES = 9, EDGE_STEPS = 56 };
static const double PLACE_M = 1e-6, GOLDEN = 0x1.3c6ef372fe95p-1;
static const double HALF_PI = 0x1.921fb54442d18p0;
static const double RADIANS = 0x1.1df46a2529d39p-6; /* pi / 180 */

Extent extent_none(void) { return (Extent){INFINITY, -INFINITY, INFINITY, -INFINITY, 0.0}; }

void extent_add(Extent *extent, const Polygon *polygon, Vector origin) {
    double check = 0.0;
    for (int64_t i = 0; i < polygon->count; i++) {
        double x = polygon->x[i] + origin.x, y = polygon->y[i] + origin.y;
        extent->west = least(extent->west, x), extent->east = most(extent->east, x);
        extent->south = least(extent->south, y), extent->north = most(extent->north, y);
        extent->furthest2 = most(extent->furthest2, x * x + y * y);
        check += 0.0 * (x + y); /* 0, or NaN */
    }
    if (!(check == 0.0)) extent->north = extent->south = extent->furthest2 = NAN;
}

Extent extent_of_both(const Extent *a, const Extent *b) {
    return (Extent){least(a->west, b->west), most(a->east, b->east), least(a->south, b->south), most(a->north, b->north),
                    most(a->furthest2, b->furthest2)};
}

Extent extent_within_reach(const KernelPlane *plane, const Extent *a, const Extent *b, double reach) {
    Extent both = extent_of_both(a, b);
    if (plane->projection != KERNEL_MERCATOR) return both;
    double south = most(a->south, b->south) - reach, north = least(a->north, b->north) + reach;
    /* Empty if they are farther apart: then the band does not matter. */
    if (south < north) both.south = most(both.south, south), both.north = least(both.north, north);
    return both;
}

double mercator_scale(const KernelPlane *plane, double y) {
    double e = exp(fabs(y) / plane->radius_m), cosine = 0.5 * (e + 1.0 / e), tangent = (e - 1.0 / e) / (e + 1.0 / e);
    return cosine * plane->radius_m / earth_conformal_radius(plane, tangent * tangent);
}

static double scale_at(const KernelPlane *plane, Vector point, Vector origin) {
    double x = point.x + origin.x, y = point.y + origin.y;
    if (plane->projection == KERNEL_MERCATOR) return mercator_scale(plane, y);
    return 1.0 + (x * x + y * y) / (plane->radius_m * plane->radius_m);
}

double plane_largest_scale(const KernelPlane *plane, const Extent *extent) {
    if (plane->projection == KERNEL_GNOMONIC) return 1.0 + extent->furthest2 / (plane->radius_m * plane->radius_m);
    return mercator_scale(plane, extent->north > -extent->south ? extent->north : extent->south);
}

double plane_smallest_scale(const KernelPlane *plane, const Extent *extent) {
    if (plane->projection == KERNEL_MERCATOR) return mercator_scale(plane, most(most(extent->south, -extent->north), 0.0));
    /* Perpendicular to the direction from the centre, at the nearest point of the box; nearer by its diagonal for
     * moving polygons. */
    double x = most(most(extent->west, -extent->east), 0.0), y = most(most(extent->south, -extent->north), 0.0);
    double diagonal = hypot(extent->east - extent->west, extent->north - extent->south);
    double nearest = most(hypot(x, y) - diagonal, 0.0) / plane->radius_m;
    return sqrt(1.0 + nearest * nearest);
}

/* Largest relative change of the conformal sphere's radius over theta radians. */
static double most_change(const KernelPlane *plane, double theta) { return 1.01 * plane->oblateness * least(theta, 1.0); }

/* Largest contribution of the conformal sphere's radius to the scale's rate of change, relative to tanh(psi). */
static double shrinks(const KernelPlane *plane) { return 3.02 * plane->oblateness; }

/* Upper bound on the conformal latitude along a shortest line whose ends have this scale, radians. */
static double highest_on_way(const KernelPlane *plane, double distance_m, double scale) {
    return least(acos(1.0 / most(scale, 1.0)) + 0.505 * distance_m / plane->radius_m, HALF_PI);
}

Scales plane_scales(const KernelPlane *plane, const Extent *extent) {
    return (Scales){plane_largest_scale(plane, extent), plane_smallest_scale(plane, extent)};
}

double plane_span_m(const KernelPlane *plane, double distance_m, double scale) {
    if (plane->projection == KERNEL_GNOMONIC) return distance_m * scale;
    /* On the sphere 2 asin(s) for s = cosh(psi) sin(theta / 2) < 1, and 2 hypot(pi / 2, acosh(s)) above; these bounds
     * are convex in ln s. */
    double theta = distance_m / plane->radius_m;
    double s = scale * (1.0 + most_change(plane, theta)) * sin(least(0.5 * theta, HALF_PI));
    if (s < 1.0) return plane->radius_m * (2.0 * s + (2.0 * HALF_PI - 2.0) * s * s * s);
    return plane->radius_m * (2.0 * HALF_PI + (6.0 * HALF_PI - 4.0) * log(s));
}

/* Mercator on the sphere: the plane distance d of places theta apart, with scales k and l, has sinh(dy / 2)^2 + sin(dx /
 * 2)^2 = S^2, S = sqrt(k l) sin(theta / 2); so d <= 2 asin(S), which is convex in ln S: at most asin(k sin(theta / 2)) +
 * asin(l sin(theta / 2)). On the ellipsoid the conformal sphere's radius R has |R''| <= 2.2 oblateness R along a line, and
 * R differs by that times theta^2 / 12 from the mean of its ends; CURVED is more than both halves of that, and than what
 * it costs to take the product of two sines for the square of one. ln k is convex in y. For s up to LARGEST_SINE asin(s) is
 * at most s + CUBIC s^3, which is convex in ln s, too.
 *
 * Gnomonic: with phi and beta the longitude and latitude about the axis that is normal to the vector n, n.x = R tan(phi)
 * and sin(dphi / 2) <= sin(theta / 2) / sqrt(cos beta cos beta'). So n.(y - x) <= R sin(theta / 2) (w + w'), w = 1 / (cos
 * beta cos(phi)^2) = sqrt(1 + |x|^2 / R^2) sqrt(1 + (n.x)^2 / R^2). Both factors are convex; so is w within 60 degrees of
 * the centre, where p^2 q^2 <= 1 + p^2 for x = R (p, q), p along n. */
static const double CURVED = 0.3, CUBIC = 0.21, LONGEST_HALF = 0.1, LARGEST_SINE = 0.5, LARGEST_GNOMONIC = 4.0;

bool plane_half_is_long(const KernelPlane *plane, double distance_m, double largest_scale) {
    double theta = distance_m / plane->radius_m;
    if (!(theta <= LONGEST_HALF)) return true;
    if (plane->projection == KERNEL_GNOMONIC) return !(largest_scale <= LARGEST_GNOMONIC);
    return !(largest_scale * theta <= 2.0 * LARGEST_SINE);
}

double plane_half_m(const KernelPlane *plane, double distance_m, Vector place, bool is_long) {
    double scale = scale_at(plane, place, (Vector){0.0, 0.0}), theta = distance_m / plane->radius_m;
    if (is_long) return 0.5 * plane_span_m(plane, distance_m, scale);
    if (plane->projection == KERNEL_GNOMONIC) return plane->radius_m * sin(0.5 * theta) * sqrt(scale);
    double sine = scale * sin(0.5 * theta * (1.0 + CURVED * plane->oblateness * theta * theta));
    return plane->radius_m * (sine + CUBIC * sine * sine * sine);
}

double plane_half_along(const KernelPlane *plane, double half_m, Vector place, Vector along, bool is_long) {
    if (is_long || plane->projection != KERNEL_GNOMONIC) return half_m;
    double tangent = (along.x * place.x + along.y * place.y) / plane->radius_m;
    return half_m * sqrt(1.0 + tangent * tangent);
}

double plane_half_error_m(const KernelPlane *plane, double distance_m, double largest_scale) {
    double theta = distance_m / plane->radius_m;
    return 0.4 * distance_m * theta * theta * largest_scale * largest_scale * largest_scale;
}

double plane_least_m(const KernelPlane *plane, double span_m, double scale) {
    if (plane->projection == KERNEL_GNOMONIC) return span_m / scale;
    double sine = sin(least(0.5 * span_m / plane->radius_m, HALF_PI));
    double theta = 2.0 * asin(least(sine / most(scale, 1.0), 1.0));
    return plane->radius_m * theta / (1.0 + most_change(plane, 1.01 * theta));
}

/* Mercator: |grad ln(scale)| bounds the symbols of a conformal metric ds = |dz| / scale. Gnomonic: a velocity v at x
 * has the covariant acceleration -2 (x.v) / (R sec(c))^2 v, |x| = R tan(c); with v measured on the earth, at least |v|
 * cos(c)^2 outward from the centre, x.v / (R sec(c)^2) is at most tan(c). */
double plane_christoffel(const KernelPlane *plane, double scale) {
    if (plane->projection == KERNEL_GNOMONIC) return 2.0 * sqrt(scale - 1.0) / plane->radius_m;
    double tangent = scale * sin(highest_on_way(plane, 0.0, scale));
    return (1.0 + shrinks(plane)) * tangent / plane->radius_m;
}

double plane_turn_m(const KernelPlane *plane) {
    return plane->projection == KERNEL_MERCATOR ? 4.0 * HALF_PI * plane->radius_m : INFINITY;
}

/* Mercator: the shortest line pulls at its ends with 1 / scale, which changes along it by tanh(psi) / radius per metre.
 * Gnomonic: with the metric ds^2 = |dx|^2 / A - (x.dx)^2 / (R A)^2, A = sec(c)^2, a shift of x at speed v changes ln ds
 * by at most 2 |x| v / R^2; in plane metres at the largest scale, A. */
double plane_drift(const KernelPlane *plane, double distance_m, double scale, double speed) {
    if (plane->projection == KERNEL_GNOMONIC) return distance_m * 2.0 * sqrt(scale - 1.0) * scale / plane->radius_m * speed;
    double sine = sin(highest_on_way(plane, distance_m, scale));
    return distance_m / plane->radius_m * (1.0 + shrinks(plane)) * sine * scale * speed;
}

/* Mercator: the shortest line turns in the plane by tan(latitude) / radius per metre. Gnomonic: the largest angle
 * between a step u and its gradient G u, where G has the eigenvalues 1 / A and 1 / A^2. */
double plane_slant(const KernelPlane *plane, double distance_m, double scale) {
    if (plane->projection == KERNEL_GNOMONIC) return atan(0.5 * (scale - 1.0) / sqrt(scale));
    double tangent = tan(least(highest_on_way(plane, distance_m, scale), HALF_PI - 1e-9));
    return distance_m / plane->radius_m * (1.0 + shrinks(plane)) * tangent;
}

double plane_distance_error_m(const KernelPlane *plane, double distance_m) {
    if (plane->projection == KERNEL_MERCATOR) return mercator_distance_error_m(plane, distance_m);
    return 2.0 * GNOMONIC_ROUNDING_M + 1e-12 * distance_m;
}

double plane_short_m(const KernelPlane *plane) {
    /* In a plane that is not conformal they never are; only touches are no nearer. */
    return plane->projection == KERNEL_MERCATOR ? SHORT_M : KERNEL_TOUCH_M;
}

void plane_degrees(const KernelPlane *plane, Vector place, double degrees[2]) {
    double x = place.x / plane->radius_m, y = place.y / plane->radius_m, lon = x / RADIANS, lat;
    if (plane->projection == KERNEL_MERCATOR) {
        lat = earth_latitude(plane, y);
    } else {
        double sine, cosine;
        earth_direction(plane->centre_lat_deg, &sine, &cosine);
        double out = cosine - y * sine, axis = sine + y * cosine;
        lon = plane->centre_lon_deg + atan2(x, out) / RADIANS, lat = atan2(axis, hypot(x, out));
    }
    double east = fmod(lon + 180.0, 360.0);
    degrees[0] = (east < 0.0 ? east + 360.0 : east) - 180.0, degrees[1] = lat / RADIANS;
    if (degrees[0] >= 180.0) degrees[0] = -180.0;
}

static double least_distance(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double gap,
                             Facing *facing, int64_t *parts_left) {
    if (plane->projection == KERNEL_MERCATOR) return mercator_distance_m(plane, a, b, origin, gap, facing, parts_left);
    return most(gnomonic_distance_m(plane, a, b, origin, facing) - GNOMONIC_ROUNDING_M, 0.0);
}

double plane_metres(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double gap, Vector from,
                    Vector to, int64_t *parts_left) {
    Facing facing;
    double metres = 2.0 * gap / (scale_at(plane, from, origin) + scale_at(plane, to, origin));
    return metres > plane_short_m(plane) ? least_distance(plane, a, b, origin, gap, &facing, parts_left) : metres;
}

double plane_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, int64_t *parts_left) {
    Vector from, to;
    Gap gap = polygon_distance(a, b, &from, &to);
    return plane_metres(plane, a, b, origin, gap.gap, from, to, parts_left);
}

double plane_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin) {
    if (plane->projection == KERNEL_MERCATOR) return mercator_way_m(plane, one, other, origin);
    return gnomonic_way_m(plane, one, other, origin);
}

static Vector along(Vector start, Vector side, double part) {
    return (Vector){start.x + part * side.x, start.y + part * side.y};
}

/* The place on a side nearest to a vertex (EDGE_PLACES). */
static Vector place_on_side(const KernelPlane *plane, Vector vertex, Vector start, Vector side, Vector origin) {
    double step = 1.0 / (EDGE_PLACES - 1), nearest = INFINITY, ends = INFINITY, best = 0.0, end = 0.0;
    for (int k = 0; k < EDGE_PLACES; k++) {
        double found = plane_way_m(plane, vertex, along(start, side, k * step), origin);
        if (found < nearest) nearest = found, best = k * step;
        if ((k == 0 || k == EDGE_PLACES - 1) && found < ends) ends = found, end = k * step;
    }
    double low = most(best - step, 0.0), high = least(best + step, 1.0), length = hypot(side.x, side.y);
    double left = high - GOLDEN * (high - low), right = low + GOLDEN * (high - low);
    double at_left = plane_way_m(plane, vertex, along(start, side, left), origin);
    double at_right = plane_way_m(plane, vertex, along(start, side, right), origin);
    for (int k = 0; k < EDGE_STEPS && (high - low) * length > PLACE_M; k++) {
        if (at_left <= at_right) {
            high = right, right = left, at_right = at_left, left = high - GOLDEN * (high - low);
            at_left = plane_way_m(plane, vertex, along(start, side, left), origin);
        } else {
            low = left, left = right, at_left = at_right, right = low + GOLDEN * (high - low);
            at_right = plane_way_m(plane, vertex, along(start, side, right), origin);
        }
    }
    return along(start, side, ends <= least(at_left, at_right) ? end : 0.5 * (low + high));
}

void plane_nearest(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, Vector *from, Vector *to,
                   int64_t *parts_left) {
    double gap = polygon_distance(a, b, from, to).gap;
    Facing facing = {a, b, 0, 0, NAN};
    if (!(plane_metres(plane, a, b, origin, gap, *from, *to, parts_left) > plane_short_m(plane))) return;
    least_distance(plane, a, b, origin, gap, &facing, parts_left);
    const Polygon *sides = facing.sides;
    int64_t k = facing.side, m = edge_end(sides, k);
    Vector vertex = {facing.vertices->x[facing.vertex], facing.vertices->y[facing.vertex]};
    Vector start = {sides->x[k], sides->y[k]}, side = {sides->x[m] - sides->x[k], sides->y[m] - sides->y[k]};
    bool is_known = !isnan(facing.share);
    Vector place = is_known ? along(start, side, facing.share) : place_on_side(plane, vertex, start, side, origin);
    *from = facing.vertices == a ? vertex : place, *to = facing.vertices == a ? place : vertex;
}

double plane_distance_within_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double within_m,
                               int64_t *parts_left) {
    Vector from, to;
    Extent extent = extent_none();
    Gap gap = polygon_distance(a, b, &from, &to);
    if (gap.gap > plane_short_m(plane)) {
        extent_add(&extent, a, origin), extent_add(&extent, b, origin);
        double largest = plane_largest_scale(plane, &extent), beyond = gap.gap - plane_span_m(plane, within_m, largest);
        if (beyond > 0.0) return within_m + beyond / largest;
    }
    return plane_metres(plane, a, b, origin, gap.gap, from, to, parts_left);
}
