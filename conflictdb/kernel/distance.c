/* How far apart two movers are, and what their distance D is nowhere below during a time of h seconds; metres on the
 * earth. Three bounds hold:
 *
 * 1. Gap. Along the direction between the nearest points in the middle the gap is concave in time if all vertices move
 *    straight: it is nowhere less than at the ends, less M h^2 / 8 where accelerations are at most M.
 * 2. Rate. |D'| is at most the relative velocity along that direction, and a share of that across it, as the direction
 *    of a shorter way may differ: S. A. Piyavskii, USSR Comput. Math. Math. Phys. 12 (1972),
 *    doi:10.1016/0041-5553(72)90115-2; B. Mirtich, thesis, Berkeley (1996).
 * 3. Second derivative. D'' is at most C: D is nowhere less than its chords less C h^2 / 8, which decides short times,
 *    however far apart and large the polygons are.
 */
#include "approach.h"

/* What holds during a time: the polygons' velocities in the middle, bounds on all vertices, and scales. */
typedef struct {
    double h, acceleration, spread; /* of both movers */
    Vector a, b;                    /* velocities */
    double fastest_a, fastest_b;    /* speeds of any vertex, plane m/s */
    double largest, smallest, width; /* scales, and how wide the plane is there from west to east, plane metres */
} Course;

double approach_distance(Encounter *pair, double t) {
    pair->work->evaluations++;
    encounter_place(pair, t);
    return most(plane_distance_m(pair->plane, &pair->a_now, &pair->b_now, pair->a.origin, &pair->parts_left), 0.0);
}

/* Put the polygons where they are at the ends of a time, and tell what holds during it; those of the middle are added. */
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

/* The least distance of places that are `gap` plane metres apart or more, also the other way round the earth. */
static double least_across(const KernelPlane *plane, double gap, const Course *course) {
    double around = plane_turn_m(plane) - course->width, nearer = least(gap, around);
    return nearer > 0.0 ? plane_least_m(plane, nearer, course->largest) : 0.0;
}

static double gap_bound(const Encounter *pair, const Course *course, Vector axis) {
    double gap = least(gap_along(axis, &pair->a0, &pair->b0), gap_along(axis, &pair->a1, &pair->b1));
    return most(gap - course->acceleration * course->h * course->h / 8.0 - KERNEL_TOUCH_M * course->largest, 0.0);
}

/* The sine of the largest angle from the axis to a way that is `reach` plane metres long at most and `gap` along the axis
 * at least; on the earth the distance may grow in another direction, by the plane's slant. 1 where the way may lead
 * round the earth. */
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

/* How fast the ends of a shortest way may move against each other across it, m/s, where what is nearest in the middle is
 * `distance` apart.
 *
 * At most the sum of both speeds v1, v2. In a plane that keeps angles it is the velocity V of one polygon against the
 * other across the way, K more for that of their vertices, and what the way turns and the scale changes on it: let N be
 * the normal of the way, which goes with it. (V_b.N_b) / k_b - (V_a.N_a) / k_a is V.N_a / k_a, and V_b times the change
 * of N / k from a to b (or V_a times the same), which is at most the plane's slant for N and as much for k. */
static double across_way(const Encounter *pair, const Course *course, Vector axis, double distance, double gap, double v1,
                         double v2) {
    const KernelPlane *plane = pair->plane;
    if (plane->projection != KERNEL_MERCATOR) return v1 + v2;
    /* Places that are nearest at some instant of the time, and what is between them at any other. */
    double furthest_m = distance + 1.5 * course->h * (v1 + v2);
    double reach = plane_span_m(plane, furthest_m, course->largest);
    double sine = largest_sine(plane, course, furthest_m, reach, gap);
    Vector v = {course->b.x - course->a.x, course->b.y - course->a.y};
    double across = fabs(cross(axis, v)) + sine * fabs(axis.x * v.x + axis.y * v.y);
    double turned = 2.0 * least(v1, v2) * plane_slant(plane, furthest_m, course->largest);
    return least(v1 + v2, (least(across, norm(v)) + course->spread) / course->smallest + turned);
}

/* A bound on the second derivative of distances, m/s^2, that are nowhere below least_m.
 *
 * A place of a polygon is a fixed convex combination of its vertices, so D is the least of the distances of two places,
 * one that moves with each polygon. For one such distance d with speeds v1, v2 and accelerations a1, a2 of its ends, and
 * w between them across the way, the second variation of arc length gives d'' <= w^2 / d + a1 + a2, as the earth's
 * curvature is nowhere negative. (If another way becomes the shortest, d is only less.) With C the largest of these
 * bounds, each d - C t^2 / 2 is concave, and so is their least. M. do Carmo, "Riemannian Geometry" (1992), chapter 9. */
static double upward(const Encounter *pair, const Course *course, Vector axis, double distance, double gap,
                     double least_m) {
    double v1 = course->fastest_a / course->smallest, v2 = course->fastest_b / course->smallest;
    double curving = plane_christoffel(pair->plane, course->largest) * (v1 * v1 + v2 * v2);
    double w = across_way(pair, course, axis, distance, gap, v1, v2);
    return w * w / least_m + curving + course->acceleration / course->smallest;
}

During approach_during(Encounter *pair, double start, double end, double first, double last, double enough) {
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
    encounter_place(pair, 0.5 * (low + high));
    Course course = course_during(pair, low, high);
    Extent a = extent_none(), b = extent_none();
    extent_add(&a, &pair->a0, pair->a.origin), extent_add(&a, &pair->a1, pair->a.origin);
    extent_add(&b, &pair->b0, pair->a.origin), extent_add(&b, &pair->b1, pair->a.origin);
    double x = most(most(a.west - b.east, b.west - a.east), 0.0), y = most(most(a.south - b.north, b.south - a.north), 0.0);
    double beyond = course.acceleration * course.h * course.h / 8.0 + KERNEL_TOUCH_M * course.largest;
    return least_across(pair->plane, hypot(x, y) - beyond, &course);
}
