/* Lower bounds on the distance D of two movers during a time of h seconds; metres on the earth. Three bounds hold:
 *
 * 1. Gap. If all vertices move straight, the gap along the direction between the nearest points in the middle is
 *    concave in time: at least its minimum at the ends, minus M h^2 / 8 for accelerations of at most M.
 * 2. Rate. |D'| is at most the relative velocity along that direction plus a fraction of that across it, as the
 *    direction of a shorter line may differ: S. A. Piyavskii, USSR Comput. Math. Math. Phys. 12 (1972),
 *    doi:10.1016/0041-5553(72)90115-2; B. Mirtich, thesis, Berkeley (1996).
 * 3. Second derivative. If D'' is at most C, D is at least its chords minus C h^2 / 8. This decides short times,
 *    however far apart and large the polygons are.
 */
#include "narrow/approach.h"

/* Motion during a time: velocities of the polygons in the middle, bounds on all vertices, and scales. */
typedef struct {
    double h, acceleration, spread; /* sums over both movers */
    Vector a, b;                    /* velocities in the middle, plane m/s */
    double fastest_a, fastest_b;    /* speeds of any vertex, plane m/s */
    double largest, smallest, width; /* scales; width of the positions from west to east, plane metres */
} Course;

double approach_distance(Encounter *pair, double t) {
    pair->work->evaluations++;
    encounter_place(pair, t);
    return most(plane_distance_m(pair->plane, &pair->a_now, &pair->b_now, pair->a.origin, &pair->parts_left), 0.0);
}

/* Compute the polygons at the ends of a time, and bounds on the motion. The polygons in the middle must be set already.
 */
static Course course_during(Encounter *pair, double start, double end) {
    Extent extent = extent_none();
    double middle = 0.5 * (start + end);
    Bounds a = mover_bounds(&pair->a, start, end), b = mover_bounds(&pair->b, start, end);
    mover_place(&pair->a, start, &pair->a0), mover_place(&pair->a, end, &pair->a1);
    mover_place(&pair->b, start, &pair->b0), mover_place(&pair->b, end, &pair->b1);
    const Polygon *polygons[6] = {&pair->a0, &pair->a_now, &pair->a1, &pair->b0, &pair->b_now, &pair->b1};
    for (int k = 0; k < 6; k++) extent_add(&extent, polygons[k], pair->a.origin);
    Course course = {.h = end - start, .acceleration = a.acceleration + b.acceleration, .spread = a.spread + b.spread};
    course.a = mover_velocity(&pair->a, middle), course.b = mover_velocity(&pair->b, middle);
    course.fastest_a = norm(course.a) + a.spread, course.fastest_b = norm(course.b) + b.spread;
    course.largest = plane_largest_scale(pair->plane, &extent);
    course.smallest = plane_smallest_scale(pair->plane, &extent);
    course.width = extent.east - extent.west;
    return course;
}

/* Smallest distance between places at least `gap` plane metres apart, also around the other side of the earth. */
static double least_across(const KernelPlane *plane, double gap, const Course *course) {
    double around = plane_turn_m(plane) - course->width, nearer = least(gap, around);
    return nearer > 0.0 ? plane_least_m(plane, nearer, course->largest) : 0.0;
}

static double gap_bound(const Encounter *pair, const Course *course, Vector axis) {
    double gap = least(gap_along(axis, &pair->a0, &pair->b0), gap_along(axis, &pair->a1, &pair->b1));
    return most(gap - course->acceleration * course->h * course->h / 8.0 - KERNEL_TOUCH_M * course->largest, 0.0);
}

/* Sine of the largest angle between the axis and a line at most `reach` plane metres long that covers at least `gap`
 * along the axis; plus the plane's slant, as distances on the earth may grow fastest in another direction. 1 if the
 * line may lead around the earth. */
static double largest_sine(const KernelPlane *plane, const Course *course, double distance, double reach, double gap) {
    if (!(gap > 0.0 && reach > 0.0) || course->width + reach >= plane_turn_m(plane)) return 1.0;
    double cosine = gap / reach;
    return sqrt(most(1.0 - cosine * cosine, 0.0)) + plane_slant(plane, distance, course->largest);
}

static double rate_bound(const Encounter *pair, const Course *course, Vector axis, double distance, double gap) {
    const KernelPlane *plane = pair->plane;
    Vector v = {course->b.x - course->a.x, course->b.y - course->a.y};
    double rate = norm(v);
    if (plane->projection == KERNEL_MERCATOR) {
        double reach = plane_span_m(plane, distance, course->largest);
        double sine = largest_sine(plane, course, distance, reach, gap);
        rate = least(rate, fabs(axis.x * v.x + axis.y * v.y) + sine * fabs(cross(axis, v)));
    }
    double speed = most(course->fastest_a, course->fastest_b);
    rate += course->spread + plane_drift(plane, distance, course->largest, speed);
    return distance - 0.5 * rate * course->h / course->smallest - KERNEL_TOUCH_M;
}

/* How fast the ends of a shortest line may move relative to each other across the line, m/s, if the nearest points in
 * the middle are `distance` apart.
 *
 * It is at most the sum of both speeds v1, v2. In a conformal plane: the relative velocity V of the polygons across the
 * line, plus K for that of their vertices, plus the turn of the line and the change of the scale along it. With N the
 * normal of the line, which moves with it, (V_b.N_b) / k_b - (V_a.N_a) / k_a is V.N_a / k_a plus V_b times the change
 * of N / k from a to b (or V_a times the same), which is at most the plane's slant for N and as much for k.
 */
static double across_way(const Encounter *pair, const Course *course, Vector axis, double distance, double gap, double v1,
                         double v2) {
    const KernelPlane *plane = pair->plane;
    if (plane->projection != KERNEL_MERCATOR) return v1 + v2;
    /* The largest distance at any instant of places that are nearest at some instant. */
    double furthest_m = distance + 1.5 * course->h * (v1 + v2);
    double reach = plane_span_m(plane, furthest_m, course->largest);
    double sine = largest_sine(plane, course, furthest_m, reach, gap);
    Vector v = {course->b.x - course->a.x, course->b.y - course->a.y};
    double across = fabs(cross(axis, v)) + sine * fabs(axis.x * v.x + axis.y * v.y);
    double turned = 2.0 * least(v1, v2) * plane_slant(plane, furthest_m, course->largest);
    return least(v1 + v2, (least(across, norm(v)) + course->spread) / course->smallest + turned);
}

/* A bound on the second derivative, m/s^2, of distances of at least least_m.
 *
 * A place of a polygon is a fixed convex combination of its vertices, so D is the minimum of the distances of two
 * places, one moving with each polygon. For one such distance d, with speeds v1, v2 and accelerations a1, a2 of its
 * ends, and w between them across the line, the second variation of arc length gives d'' <= w^2 / d + a1 + a2, as the
 * earth's curvature is nowhere negative. (If another line becomes the shortest, d is only smaller.) With C the largest
 * of these bounds, each d - C t^2 / 2 is concave, and so is their minimum. M. do Carmo, "Riemannian Geometry" (1992),
 * chapter 9.
 */
static double upward(const Encounter *pair, const Course *course, Vector axis, double distance, double gap, double least_m) {
    double v1 = course->fastest_a / course->smallest, v2 = course->fastest_b / course->smallest;
    double curving = plane_christoffel(pair->plane, course->largest) * (v1 * v1 + v2 * v2);
    double w = across_way(pair, course, axis, distance, gap, v1, v2);
    return w * w / least_m + curving + course->acceleration / course->smallest;
}

During approach_during(Encounter *pair, double start, double end, double first, double last, double enough) {
    REQUIRE(start <= end);
    Vector from, to;
    pair->work->windows++;
    encounter_place(pair, 0.5 * (start + end));
    Gap middle = polygon_distance(&pair->a_now, &pair->b_now, &from, &to);
    Course course = course_during(pair, start, end);
    double gap = gap_bound(pair, &course, middle.axis);
    During found = {INFINITY, least_across(pair->plane, gap, &course)};
    if (found.bound > 0.0 && found.bound >= enough) return found;
    pair->work->evaluations++;
    double metres =
        plane_metres(pair->plane, &pair->a_now, &pair->b_now, pair->a.origin, middle.gap, from, to, &pair->parts_left);
    found.middle = most(metres, 0.0);
    found.bound = most(found.bound, rate_bound(pair, &course, middle.axis, found.middle, gap));
    if (!(found.bound > 0.0)) return found;
    double half = 0.5 * course.h, drop = upward(pair, &course, middle.axis, found.middle, gap, found.bound);
    drop *= half * half / 8.0;
    double chords = least(least_on_chord(first, found.middle, drop), least_on_chord(found.middle, last, drop));
    found.bound = most(found.bound, chords - KERNEL_TOUCH_M);
    return found;
}

double approach_at_least(Encounter *pair, double low, double high) {
    REQUIRE(low <= high);
    encounter_place(pair, 0.5 * (low + high));
    Course course = course_during(pair, low, high);
    Extent a = extent_none(), b = extent_none();
    extent_add(&a, &pair->a0, pair->a.origin), extent_add(&a, &pair->a1, pair->a.origin);
    extent_add(&b, &pair->b0, pair->a.origin), extent_add(&b, &pair->b1, pair->a.origin);
    double x = most(most(a.west - b.east, b.west - a.east), 0.0), y = most(most(a.south - b.north, b.south - a.north), 0.0);
    double beyond = course.acceleration * course.h * course.h / 8.0 + KERNEL_TOUCH_M * course.largest;
    return least_across(pair->plane, hypot(x, y) - beyond, &course);
}
