/* The planes: how many plane metres a metre on the earth is, and distances on the earth (conflictdb.motion.contract).
 *
 * The scale is that at the ends of a way at most: it is convex along straight lines in both planes.
 */
#ifndef CONFLICTDB_PLANE_H
#define CONFLICTDB_PLANE_H

#include "earth.h"
#include "polygon.h"

/* What bounds the vertices of some polygons, plane metres from the plane's own origin. */
typedef struct {
    double west, east, south, north, furthest2; /* the last: squared distance from the plane's origin */
} Extent;

Extent extent_none(void);

/* Extend by a polygon counted from an origin. A vertex that is no number makes the extent none. */
void extent_add(Extent *extent, const Polygon *polygon, Vector origin);

/* Of two extents, the part in which places of either lie that are no further apart than a reach, plane metres. In the
 * Mercator plane, where the scale depends on the ordinate alone, that is a band; in another it is both. */
Extent extent_within_reach(const KernelPlane *plane, const Extent *a, const Extent *b, double reach);

/* The most plane metres per metre, any way, and the fewest (>= 1), in the hull of all that was added. */
double plane_largest_scale(const KernelPlane *plane, const Extent *extent);
double plane_smallest_scale(const KernelPlane *plane, const Extent *extent);

/* Both. */
typedef struct {
    double largest, smallest;
} Scales;
Scales plane_scales(const KernelPlane *plane, const Extent *extent);

/* How many plane metres a distance on the earth may take up where the scale at its ends is at most this. */
double plane_span_m(const KernelPlane *plane, double distance_m, double scale);

/* The least distance on the earth, metres, of places so many plane metres apart, no turn of longitude between them. */
double plane_least_m(const KernelPlane *plane, double span_m, double scale);

/* A bound on the Christoffel symbols, 1/m: what is even in the plane at v m/s on the earth accelerates by this v^2. */
double plane_christoffel(const KernelPlane *plane, double scale);

/* Plane metres of one turn of longitude; infinite where there is no seam. */
double plane_turn_m(const KernelPlane *plane);

/* At what rate, plane m/s, distances on the earth may change for points that keep their plane distance. */
double plane_drift(const KernelPlane *plane, double distance_m, double scale, double speed);

/* The largest angle between the line between two places and where distances grow fastest, radians. */
double plane_slant(const KernelPlane *plane, double distance_m, double scale);

/* By how much plane_distance_m may understate a distance, metres. */
double plane_distance_error_m(const KernelPlane *plane, double distance_m);

/* The longitude, in [-180, 180), and the latitude of a place, degrees. */
void plane_degrees(const KernelPlane *plane, Vector place, double degrees[2]);

/* Up to how many metres the nearest points in the plane are those on the earth, to rounding. */
double plane_short_m(const KernelPlane *plane);

/* Halvings of sides that all distances far away of two objects may take together: two seconds or so. Usual are thousands,
 * and millions within five degrees of a pole. With fewer, pairs there are unresolved. */
enum { PLANE_MAX_PARTS = 1 << 24 };

/* The signed separation in metres on the earth: the length of the shortest way between polygons that are apart; of
 * those that overlap their depth. Never overstated; understated by plane_distance_error_m at most.
 *
 * parts_left: halvings of sides that may still be taken, less those that are. Below 0 there are too few, now or before:
 * what is far away counts as 0 metres then, which is not overstated and says nothing. */
double plane_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, int64_t *parts_left);

/* The same where it is at most within_m; else any number above that. */
double plane_distance_within_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double within_m,
                               int64_t *parts_left);

/* The same, where the separation in the plane is known, and its nearest points or middles. */
double plane_metres(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double gap, Vector from,
                    Vector to, int64_t *parts_left);

/* The nearest points on the earth of polygons that are apart, from the origin. */
void plane_nearest(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, Vector *from, Vector *to,
                   int64_t *parts_left);

/* The distance of two places from the origin: at least that of the shortest way. */
double plane_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin);

/* The vertex and the side that are nearest to each other. share: how far along the side that is, to a micrometre; NaN
 * where it is not known. */
typedef struct {
    const Polygon *vertices, *sides;
    int64_t vertex, side;
    double share;
} Facing;

/* Each plane: the least distance of polygons that are apart, and what faces each other there; nearest: that in the
 * plane. And the distance of two places from the origin. */
double mercator_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, double nearest,
                           Facing *facing, int64_t *parts_left);
double gnomonic_distance_m(const KernelPlane *plane, const Polygon *a, const Polygon *b, Vector origin, Facing *facing);
double mercator_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin);
double gnomonic_way_m(const KernelPlane *plane, Vector one, Vector other, Vector origin);
double mercator_distance_error_m(const KernelPlane *plane, double distance_m);

/* Mercator: plane metres per metre at an ordinate. */
double mercator_scale(const KernelPlane *plane, double y);

#endif
