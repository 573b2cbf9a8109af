/* The smallest distance on the earth between polygons whose edges are rhumb lines, at any distance. Longitude and psi
 * are in radians; longitudes count from the pair's origin.
 *
 * For two points z = dlon + i dpsi apart in the Mercator plane, the great circle of the conformal sphere has the length
 * theta with sin^2(theta / 2) = |sin(z / 2)|^2 sech psi1 sech psi2. So ln sin^2(theta / 2) is a harmonic function of z,
 * minus ln cosh psi1 and ln cosh psi2. Two consequences:
 *
 * The minimum is between a vertex and an edge. Along two edges with directions a and b the second derivatives are X -
 * s1, Y - s2 and -Z, with X Y - Z^2 = -m^2 sin^2(angle between a and b) and s1, s2 >= 0 from ln cosh. If X - s1 and Y -
 * s2 are positive, the determinant is negative: no pair of places inside both edges is a minimum. On the ellipsoid the
 * radius of the conformal sphere changes s1, s2 and Z by less than 3 % of s1 and s2, which keeps the sign.
 *
 * At the nearest place of an edge, the derivative of the harmonic function equals that of ln cosh psi. Short distances
 * are solved by fixed-point iteration, whose steps leave (0.68 z^2)^2 each of z^2 / 8 of the distance; any distance by
 * branch and bound.
 *
 * On the ellipsoid a distance is at most theta times the mean radius along the great circle. It is shorter by what
 * another path saves that runs through smaller radii: at most `overstated_m`.
 */
#include <math.h>

#include "planes/plane.h"
#include "geometry/runs.h"

/* Distances below this, plane radians, are solved by fixed-point iteration. */
static const double NEARBY = 0.25;
/* Relative error of that iteration, and relative accuracy of bounds. */
static const double SOLVED_SHARE = 2e-11;
enum { STEPS = 4, MAX_HALVINGS = 60 };
/* Bisections for one distance before it is solved with less effort: on the sphere by sharper bounds, which take longer;
 * on an ellipsoid to a fraction of its error bound. Smaller: ordinary distances take longer, or are understated by
 * more. */
enum { PATIENCE = 256 };
/* Most bisections of one distance: a hundred times the most seen within five degrees of a pole. Smaller: distances
 * there are unknown. Only edges that go around the earth many times take more. */
enum { MAX_PARTS = 1 << 18 };
/* Absolute accuracy, metres, a tenth of the rounding of coordinates: a touch across the antimeridian has no relative
 * accuracy. */
static const double FINEST_M = 1e-9;
/* Margin for rounding when cosines of angles are compared: ten times the rounding error. */
static const double ROUNDING = 3e-14;
/* The iteration has converged if its last step is at most this, metres. */
static const double KNOWN_M = 1e-6;
/* Longer great circles, radians, are bounded by the smallest and the largest radius only. */
static const double LONGEST = 2.9;
static const double TURN = 0x1.921fb54442d18p2; /* 2 pi */
/* Gauss-Legendre quadrature of the radius along a great circle: nodes on [-1, 1] and weights. */
static const double NODES[6] = {-0.9324695142031519, -0.6612093864662645, -0.2386191860831969,
                                0.2386191860831969,  0.6612093864662645,  0.9324695142031519};
static const double WEIGHTS[6] = {0.17132449237917027, 0.3607615730481387, 0.46791393457269104,
                                  0.46791393457269104, 0.3607615730481387, 0.17132449237917027};

/* A place; an edge: longitude and psi of its start, and the vector along it. */
typedef struct {
    double lon, psi;
} Place;
typedef struct {
    Place start, way;
} Edge;

static double polar_radius_m(const KernelPlane *earth) { return earth_conformal_radius(earth, 1.0); }

/* Error bound of Simpson's rule for the mean radius, c theta^5 / 360, for distances where it is used (NEARBY). */
static double rule_error_m(const KernelPlane *earth, double distance_m) {
    double theta = distance_m / polar_radius_m(earth), near = least(theta, NEARBY);
    return earth->radius_m * earth->oblateness / 360.0 * near * near * near * near * theta;
}

/* How much a computed distance may exceed the shortest one: a path through smaller radii saves c^2 (2 tan(theta / 2) -
 * theta) / 2 to second order, doubled here for higher orders; above `longest` radians at most the ratio of the radii.
 */
static double overstated_m(const KernelPlane *earth, double distance_m, double longest) {
    double c = earth->oblateness, theta = distance_m / polar_radius_m(earth), saved = 1.001 * c * theta;
    if (theta <= longest) saved = c * c * most(2.0 * tan(0.5 * theta) - theta, 0.0);
    return earth->radius_m * saved + 2.0 * rule_error_m(earth, distance_m) + SOLVED_SHARE * distance_m;
}

double mercator_distance_error_m(const KernelPlane *plane, double distance_m) {
    /* The distance may have been computed above LONGEST, and reduced by the largest saving. */
    double longest = LONGEST * (1.0 - 1.01 * plane->oblateness);
    return 1.01 * (overstated_m(plane, distance_m, longest) + rule_error_m(plane, distance_m));
}

/* The smallest distance of a vertex from an edge, if below NEARBY in the plane; elsewhere an overestimate. share: how
 * far along the edge, NaN if not converged. */
static double nearby_m(const KernelPlane *earth, Place point, Edge edge, double *share) {
    double length = hypot(edge.way.lon, edge.way.psi), divisor = length > 0.0 ? length : 1.0;
    double ux = edge.way.lon / divisor, uy = edge.way.psi / divisor;
    double wx = point.lon - edge.start.lon, wy = point.psi - edge.start.psi;
    double foot = wx * ux + wy * uy, off = wx * uy - wy * ux;
    /* z / 6 along the edge, and the decrease of the conformal sphere's radius. */
    double slope = (ux * ux - uy * uy) / 6.0, level = (ux * wx - uy * wy) / 6.0, shrinks = 2.0 * earth->oblateness;
    double along = least(most(foot, 0.0), length), before = along;
    for (int step = 0; step < STEPS; step++) {
        double square = off * off + (along - foot) * (along - foot), sine = tanh(edge.start.psi + along * uy);
        double pull = uy * sine * (1.0 + shrinks - shrinks * sine * sine) + slope * along - level;
        before = along, along = least(most(foot + 0.5 * square * pull, 0.0), length);
    }
    *share = fabs(along - before) * earth->radius_m <= KNOWN_M ? along / divisor : NAN;
    double psi_foot = edge.start.psi + along * uy;
    double east = sin(0.5 * (wx - along * ux)), north = sinh(0.5 * (wy - along * uy));
    double half = sqrt(east * east + north * north) / sqrt(cosh(point.psi) * cosh(psi_foot));
    half = half < 1.0 ? half : 1.0;
    double angle = 2.0 * asin(half);
    if (!(earth->oblateness > 0.0)) return earth->radius_m * angle;
    /* Simpson's rule for the radius along the great circle; middle2 is the squared sine of the latitude in the middle.
     */
    double sine1 = tanh(point.psi), sine2 = tanh(psi_foot), middle2 = 0.25 * (sine1 + sine2) * (sine1 + sine2);
    middle2 = half < 1.0 ? middle2 / (1.0 - half * half) : 0.0;
    double mean = earth_conformal_radius(earth, sine1 * sine1) + earth_conformal_radius(earth, sine2 * sine2);
    mean += 4.0 * earth_conformal_radius(earth, middle2 <= 1.0 ? middle2 : 0.0);
    return mean / 6.0 * angle;
}

/* Length on the earth of the great circle of the conformal sphere: at least that of the shortest line. */
static double way_m(const KernelPlane *earth, Place a, Place b) {
    /* Sine and cosine separately: near the antipode the digits of one are lost in the other. */
    double sine = hypot(sin(0.5 * (b.lon - a.lon)), sinh(0.5 * (b.psi - a.psi)));
    double cosine = hypot(cos(0.5 * (b.lon - a.lon)), sinh(0.5 * (a.psi + b.psi))), theta = 2.0 * atan2(sine, cosine);
    if (!(earth->oblateness > 0.0)) return earth->radius_m * theta;
    double sine1 = tanh(a.psi), sine2 = tanh(b.psi), whole = sin(theta), mean = 0.0;
    if (theta > LONGEST || !(whole > 0.0)) return earth->radius_m * theta;
    for (int k = 0; k < 6; k++) {
        double part = 0.5 + 0.5 * NODES[k];
        double between = (sin((1.0 - part) * theta) * sine1 + sin(part * theta) * sine2) / whole;
        mean += 0.5 * WEIGHTS[k] * earth_conformal_radius(earth, least(between * between, 1.0));
    }
    return mean * theta;
}

/* A part of an edge, with the distances of a point from both ends. */
typedef struct {
    double low, high, first, last;
    int halvings;
} Part;

/* Lower bound on the distance of a point from a part of an edge. On a surface curved like the earth it bends upwards by
 * at most v^2 / distance along a straight line of the plane, which itself bends by v tanh psi; v is metres per radian
 * of the plane. */
static double least_between(const KernelPlane *earth, Edge edge, Part part) {
    double psi0 = edge.start.psi + part.low * edge.way.psi, psi1 = edge.start.psi + part.high * edge.way.psi;
    double nearest_equator = psi0 * psi1 > 0.0 ? least(fabs(psi0), fabs(psi1)) : 0.0;
    double v = earth->radius_m / cosh(nearest_equator), width = hypot(edge.way.lon, edge.way.psi) * (part.high - part.low);
    double nearest = 0.5 * (part.first + part.last - width * v);
    if (!(nearest > 0.0)) return 0.0;
    double bend = v * v / (0.99 * nearest) + 1.01 * v * tanh(most(fabs(psi0), fabs(psi1)));
    return most(least_on_chord(part.first, part.last, bend * width * width / 8.0), nearest);
}

/* Whether a whole part of an edge is proven to be at least far_m from a point, on the sphere.
 *
 * With k the cosine of far_m, F = cosh psi (cos theta - k) is T sinh psi - k cosh psi + S cos x at x radians of
 * longitude from the point; T and S are tanh and sech of its psi. Along the edge these are exponentials and a cosine. F
 * < 0 if its Taylor polynomial of degree 3 about the middle plus the remainder is negative: the remainder is of the
 * fourth power of the part's length, where that of least_between is of the second.
 */
static bool is_sphere_beyond(const KernelPlane *earth, Place point, Edge edge, Part part, double far_m) {
    double middle = 0.5 * (part.low + part.high), half = 0.5 * (part.high - part.low);
    double psi = edge.start.psi + middle * edge.way.psi, x = edge.start.lon + middle * edge.way.lon - point.lon;
    double a = half * edge.way.psi, b = half * edge.way.lon, t = tanh(point.psi), k = cos(far_m / earth->radius_m);
    /* Longer parts are halved; larger longitudes have lost their digits. */
    if (!(fabs(a) <= 1.0 && fabs(b) <= 1.0 && fabs(x) <= 2.0 * TURN)) return false;
    double tangent = tanh(psi), s = 1.0 / (cosh(point.psi) * cosh(psi)), even = t * tangent - k, odd = t - k * tangent;
    double cosine = s * cos(x), sine = s * sin(x);
    double first = odd * a - sine * b, second = even * a * a - cosine * b * b, third = odd * a * a * a + sine * b * b * b;
    double rest = (fabs(even) * cosh(a) + fabs(odd) * sinh(fabs(a))) * a * a * a * a + s * b * b * b * b;
    double largest = even + cosine + fabs(first) + 0.5 * second;
    if (second < 0.0 && fabs(first) < -second) largest = even + cosine - 0.5 * first * first / second;
    return largest + fabs(third) / 6.0 + rest / 24.0 < -ROUNDING;
}

/* Search for the smallest distance of a point from edges. best: the smallest distance found; floor: a lower bound on
 * finished parts. A dozen bisections are usual; along an edge of nearly constant distance, a hundred thousand. When
 * *parts_left falls below 0 the result is unknown. patience: bisections before sharper bounds are tried. */
typedef struct {
    const KernelPlane *earth;
    double best, floor;
    int64_t *parts_left, patience;
} Search;

/* Parts at least this far, metres, are finished. */
static double known_from(const Search *search) {
    double left = FINEST_M, known_m = search->best * (1.0 - SOLVED_SHARE);
    if (search->patience >= 0) return known_m;
    /* Half of the quadrature error is part of the reported error bound already. */
    left = most(left, 0.5 * rule_error_m(search->earth, search->best));
    return least(known_m, search->best - left);
}

static double least_on_part(const Search *search, Place point, Edge edge, Part part) {
    const KernelPlane *earth = search->earth;
    double bound = least_between(earth, edge, part), known_m = known_from(search);
    if (!(bound < known_m) || search->patience >= 0 || earth->oblateness > 0.0) return bound;
    return is_sphere_beyond(earth, point, edge, part, known_m) ? known_m : bound;
}

static void search_edge(Search *search, Place point, Edge edge) {
    const KernelPlane *earth = search->earth;
    Place end = {edge.start.lon + edge.way.lon, edge.start.psi + edge.way.psi};
    Part stack[MAX_HALVINGS + 2];
    int top = 0;
    stack[top++] = (Part){0.0, 1.0, way_m(earth, point, edge.start), way_m(earth, point, end), 0};
    while (top > 0) {
        Part part = stack[--top];
        search->best = least(search->best, least(part.first, part.last));
        double bound = least_on_part(search, point, edge, part);
        if (!(bound < known_from(search)) || part.halvings >= MAX_HALVINGS) {
            search->floor = least(search->floor, bound);
            continue;
        }
        REQUIRE(top <= MAX_HALVINGS);
        if (--search->patience < PATIENCE - MAX_PARTS) *search->parts_left = 0;
        if (--*search->parts_left < 0) return;
        double middle = 0.5 * (part.low + part.high);
        Place place = {edge.start.lon + middle * edge.way.lon, edge.start.psi + middle * edge.way.psi};
        double found = way_m(earth, point, place);
        stack[top++] = (Part){part.low, middle, part.first, found, part.halvings + 1};
        stack[top++] = (Part){middle, part.high, found, part.last, part.halvings + 1};
    }
}

static Place place_of(const KernelPlane *earth, const Polygon *polygon, int64_t i, Vector origin) {
    return (Place){polygon->x[i] / earth->radius_m, (polygon->y[i] + origin.y) / earth->radius_m};
}

/* State of the search for the smallest nearby distance: vertices and sides farther apart than `beyond` and at most
 * `within` plane metres. Pairs that span more at the largest scale are not nearer. */
typedef struct {
    const KernelPlane *earth;
    Vector origin;
    double scale, beyond, within, found;
    Facing *facing;
} Nearby;

/* Enlarged by the rounding error bound. */
static double reach_of(double span) { return span * (1.0 + 1e-9) + 1e-6; }

static double look_nearby(void *of, const Polygon *vertices, Range range, const Polygon *sides, Range among) {
    Nearby *nearby = of;
    const KernelPlane *earth = nearby->earth;
    Vector origin = nearby->origin;
    double found = nearby->found, within2 = nearby->within * nearby->within, beyond2 = nearby->beyond * nearby->beyond;
    for (int64_t i = range.first; i < range.end; i++)
        for (int64_t k = among.first; k < among.end; k++) {
            int64_t m = edge_end(sides, k);
            Vector way = {vertices->x[i] - sides->x[k], vertices->y[i] - sides->y[k]};
            Vector side = {sides->x[m] - sides->x[k], sides->y[m] - sides->y[k]};
            double square = squared_distance(way, side);
            if (square > within2 || square <= beyond2) continue;
            Edge edge = {place_of(earth, sides, k, origin), {side.x / earth->radius_m, side.y / earth->radius_m}};
            double share, distance = nearby_m(earth, place_of(earth, vertices, i, origin), edge, &share);
            if (distance < found) found = distance, *nearby->facing = (Facing){vertices, sides, i, k, share};
        }
    if (found < nearby->found && vertices->is_in_runs)
        nearby->within = least(nearby->within, reach_of(plane_span_m(earth, found, nearby->scale)));
    nearby->found = found;
    return nearby->within;
}

/* For polygons more than NEARBY apart: one search per vertex and side. */
static void search_all(Search *search, const Polygon *vertices, const Polygon *sides, Vector origin, Facing *facing) {
    const KernelPlane *earth = search->earth;
    for (int64_t i = 0; i < vertices->count; i++)
        for (int64_t k = 0; k < sides->count && *search->parts_left >= 0; k++) {
            int64_t m = edge_end(sides, k);
            Edge edge = {place_of(earth, sides, k, origin),
                         {(sides->x[m] - sides->x[k]) / earth->radius_m, (sides->y[m] - sides->y[k]) / earth->radius_m}};
            double before = search->best;
            search_edge(search, place_of(earth, vertices, i, origin), edge);
            if (search->best < before) *facing = (Facing){vertices, sides, i, k, NAN};
        }
}

double mercator_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double nearest,
                           Facing *facing, int64_t *parts_left) {
    Extent extent = extent_none();
    extent_add(&extent, a, origin), extent_add(&extent, b, origin);
    double scale = plane_largest_scale(plane, &extent), width = (extent.east - extent.west) / plane->radius_m;
    /* First the nearest places in the plane, then all that may be nearer on the earth: places that span more of the
     * plane are not. */
    Nearby nearby = {plane, origin, scale, 0.0, reach_of(nearest), INFINITY, facing};
    double within = nearby.within;
    runs_visit(a, b, within, look_nearby, &nearby);
    nearby.beyond = within, nearby.within = reach_of(plane_span_m(plane, nearby.found, scale));
    if (nearby.within > within) runs_visit(a, b, nearby.within, look_nearby, &nearby);
    double found = nearby.found;
    /* This is the minimum if all equally near places lie nearby in the plane, and none across the antimeridian. */
    if (plane_span_m(plane, found, scale) > NEARBY * plane->radius_m || width > TURN - NEARBY) {
        Search search = {plane, INFINITY, INFINITY, parts_left, PATIENCE};
        search_all(&search, a, b, origin, facing);
        search_all(&search, b, a, origin, facing);
        if (*parts_left < 0) return 0.0;
        found = least(search.floor, search.best);
    }
    found -= overstated_m(plane, found, LONGEST);
    return found < 0.0 ? 0.0 : found;
}

double mercator_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin) {
    Place a = {one.x / plane->radius_m, (one.y + origin.y) / plane->radius_m};
    return way_m(plane, a, (Place){other.x / plane->radius_m, (other.y + origin.y) / plane->radius_m});
}
