/* Planes: scale (plane metres per metre) and distances on the earth (conflictdb.earth.plane).
 *
 * Along a straight line the scale is at most that at its ends: it is convex along straight lines in both planes.
 */
#ifndef CONFLICTDB_PLANE_H
#define CONFLICTDB_PLANE_H

#include "planes/earth.h"
#include "geometry/polygon.h"

/* Bounds on the vertices of polygons, plane metres from the plane's own origin. */
typedef struct {
    double west, east, south, north, furthest2; /* furthest2: largest squared distance from the plane's origin */
} Extent;

Extent extent_none(void);

/* Extend by a polygon relative to an origin. A NaN vertex makes the extent NaN. */
void extent_add(Extent *extent, const Polygon *polygon, Vector origin);

Extent extent_of_both(const Extent *a, const Extent *b);

/* The part of two extents in which places of one lie within `reach` plane metres of the other. In the Mercator plane,
 * where the scale depends on y only, a band; otherwise their union. */
Extent extent_within_reach(const KernelPlane *plane, const Extent *a, const Extent *b, double reach);

/* Largest and smallest scale (>= 1), in any direction, in the hull of all polygons that were added. */
double plane_largest_scale(const KernelPlane *plane, const Extent *extent);
double plane_smallest_scale(const KernelPlane *plane, const Extent *extent);

/* Both scales. */
typedef struct {
    double largest, smallest;
} Scales;
Scales plane_scales(const KernelPlane *plane, const Extent *extent);

/* Upper bound on the plane metres of a distance on the earth, with scales at its ends of at most `scale`. */
double plane_span_m(const KernelPlane *plane, double distance_m, double scale);

/* Halves of a distance on the earth, in plane metres: two places within distance_m of each other are at most half(one) +
 * half(other) apart along any unit vector. Halves are convex along straight lines, so that a polygon reaches farthest,
 * its half included, at a vertex. is_long: the coarser bound for long distances and for places near the poles or far from
 * the centre, see plane_half_is_long. place: from the plane's own origin.
 *
 * Mercator: the same along every vector. Gnomonic: plane_half_along adapts it to one.
 */
double plane_half_m(const KernelPlane *plane, double distance_m, Vector place, bool is_long);
double plane_half_along(const KernelPlane *plane, double half_m, Vector place, Vector along, bool is_long);
bool plane_half_is_long(const KernelPlane *plane, double distance_m, double largest_scale);

/* How much larger than needed half(one) + half(other) may be, plane metres; not for long distances. */
double plane_half_error_m(const KernelPlane *plane, double distance_m, double largest_scale);

/* Smallest distance on the earth, metres, of places span_m plane metres apart, without a turn of longitude between
 * them. */
double plane_least_m(const KernelPlane *plane, double span_m, double scale);

/* Bound on the Christoffel symbols, 1/m: uniform motion in the plane, at v m/s on the earth, accelerates by this times
 * v^2. */
double plane_christoffel(const KernelPlane *plane, double scale);

/* Plane metres of a full turn of longitude; infinite in a plane without an antimeridian. */
double plane_turn_m(const KernelPlane *plane);

/* Rate, plane m/s, at which distances on the earth may change between points of constant plane distance that move at
 * `speed`. */
double plane_drift(const KernelPlane *plane, double distance_m, double scale, double speed);

/* Largest angle, radians, between the plane line of two places and the direction in which their distance grows fastest.
 */
double plane_slant(const KernelPlane *plane, double distance_m, double scale);

/* How much plane_distance_m may understate a distance, metres. */
double plane_distance_error_m(const KernelPlane *plane, double distance_m);

/* Longitude in [-180, 180) and latitude of a place, degrees. */
void plane_degrees(const KernelPlane *plane, Vector place, double degrees[2]);

/* Up to this many metres the nearest points in the plane are the nearest on the earth, to rounding. */
double plane_short_m(const KernelPlane *plane);

/* Work budget: bisections of sides for all far distances of two objects, about two seconds. Thousands are usual,
 * millions within five degrees of a pole. Smaller: pairs there are unresolved. */
enum { PLANE_MAX_PARTS = 1 << 24 };

/* Signed separation in metres on the earth: the length of the shortest line between polygons that are apart, minus the
 * depth of those that overlap. Of polygons apart never overstated; understated by at most plane_distance_error_m. A depth is
 * measured in the plane, at the mean scale of both middles.
 *
 * parts_left: remaining budget of bisections, reduced by those used. Below 0 it is exhausted: far distances are
 * returned as 0, which is not overstated but means unknown.
 */
double plane_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, int64_t *parts_left);

/* The same if it is at most within_m; else any number above within_m. */
double plane_distance_within_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double within_m,
                               int64_t *parts_left);

/* The same, given the plane gap and its nearest points or middles. */
double plane_metres(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double gap, Vector from,
                    Vector to, int64_t *parts_left);

/* Nearest points on the earth of polygons that are apart, relative to the origin. */
void plane_nearest(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, Vector *from, Vector *to,
                   int64_t *parts_left);

/* Length of the line between two places relative to the origin: at least that of the shortest line. */
double plane_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin);

/* The nearest vertex and side. share: fraction along the side, to a micrometre; NaN if unknown. */
typedef struct {
    const Polygon *vertices, *sides;
    int64_t vertex, side;
    double share;
} Facing;

/* Implementation of each plane: smallest distance of polygons that are apart, and the nearest vertex and side; nearest:
 * the plane distance. Length of the line between two places relative to the origin. */
double mercator_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double nearest,
                           Facing *facing, int64_t *parts_left);
double gnomonic_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, Facing *facing);
double mercator_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin);
double gnomonic_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin);
double mercator_distance_error_m(const KernelPlane *plane, double distance_m);

/* Mercator: scale at y. */
double mercator_scale(const KernelPlane *plane, double y);

#endif
