/* conflictdb kernel: contacts, distances and candidate pairs of moving convex polygons.
 *
 * The only public header.
 * Stages: boxes (1: broad/boxes.c, bundles.c), swept hulls (2: broad/hulls.c, apart.c), closed form (3: step 1 of
 * narrow/certain.c), certified windows and search (4: the rest of certain.c, search.c, proofs.c). The loop over pairs is
 * in narrow/contacts.c, the memory of an encounter in scene/border.c, the motion on great circles in planes/circle.c.
 *
 * A haven is the protected polygon that a ship or an aircraft carries along its legs. A piece is a convex polygon that
 * stands still (part of an area) or moves along one leg (a haven, or part of one). A scene is the prepared pieces of a
 * batch. For a pair of pieces during [low_s, high_s] the kernel reports every contact, and proves that there is no other
 * or reports the pair as unresolved (KernelVerdict). The proofs cover the continuous motion and allow for rounding;
 * nothing is decided by sampling. docs/explanation/kernel.md explains how.
 *
 * Units: metres, seconds, degrees. "Plane metres" are coordinates of the plane in which legs and edges are straight.
 * Instants are microseconds since 1970; the times of a pair are seconds from its own zero.
 * Thread safety: there is no global state. A KernelScene is immutable; any number of threads may share it.
 * Determinism: the answer for a pair does not depend on the other pairs of the call, nor on the order of pairs.
 * Errors: counts, offsets and indices are validated (KernelStatus); unless a call returns KERNEL_OK, its results are
 * incomplete. NaN and infinite coordinates are valid input: their piece is invalid, and its pairs are KERNEL_UNRESOLVED,
 * NaN or unknown. The broad phase is another matter: a box with NaN is in no pair, so callers report pieces without a hull.
 * Memory: each call frees its working memory. Callers allocate the result arrays, with exceptions: free scenes with
 * kernel_scene_free, box trees with kernel_box_tree_free, and lists of unknown length with kernel_free.
 *
 * Sections, and the folders that implement them: status and limits; scene (scene/); narrow phase (narrow/); regions
 * (regions/); broad phase (broad/); bytes (bytes/). They share planes/ (motion and distances in a plane) and geometry/
 * (polygons, roots).
 */
#ifndef CONFLICTDB_KERNEL_H
#define CONFLICTDB_KERNEL_H

#include <stdint.h>

/* Marks the functions that the library exports. All others are hidden (-fvisibility=hidden). */
#if defined(__GNUC__)
#define KERNEL_API __attribute__((visibility("default")))
#else
#define KERNEL_API
#endif

/* ---- Status and limits ------------------------------------------------------------------------------------------ */

/* Raise by one with every change of a structure's layout, of a constant's value, or of a function's arguments. */
#define KERNEL_ABI 27

/* Contact tolerance, metres on the earth: polygons this close touch. Coordinates are rounded to 1e-8 m, and a touch must
 * not become a miss. Larger: contacts are reported too long. Smaller: rounding decides. */
#define KERNEL_TOUCH_M 5e-8

/* How far heights of a piece may be beyond those of its object, metres: with a vertical separation they are rounded, and with
 * closed intervals those of climbs are extended by this. */
#define KERNEL_HEIGHT_ROUNDING_M 1e-9

/* Extra padding of hulls, metres: plane coordinates reach 4e7 m, where doubles are 7.5e-9 m apart, and a vertex is a sum
 * of about ten of them. Larger: more candidate pairs. Smaller: rounding may hide a touch. */
#define KERNEL_ROUNDING_M 1e-6

/* The padded hull of a piece of n vertices has at most HULL_PER_VERTEX n + HULL_MORE vertices, closing vertex included. */
#define KERNEL_HULL_PER_VERTEX 6
#define KERNEL_HULL_MORE 5

/* The region of two pieces of n vertices together has at most REGION_PER_VERTEX n + REGION_MORE vertices. */
#define KERNEL_REGION_PER_VERTEX 8
#define KERNEL_REGION_MORE 8

/* Coefficients of the longest series of a figure of the earth. */
#define KERNEL_HARMONICS 6
#define KERNEL_RADII 7

/* Instants lie within plus and minus this, microseconds, so that their differences fit into 64 bits. */
#define KERNEL_LATEST_US (INT64_C(1) << 61)

/* Instants of spans without a beginning or an end. */
#define KERNEL_MINUS_INFINITY_US INT64_MIN
#define KERNEL_INFINITY_US INT64_MAX

/* Seconds of a pair lie within plus and minus this, the largest difference of two 64-bit instants. */
#define KERNEL_LONGEST_S (0x1p64 / 1e6)

/* A haven of more vertices is an invalid piece: the time of a pair grows with the square of the number, to half a second.
 * Areas have no limit: for a polygon that stands still only its own edges count. */
#define KERNEL_MOST_VERTICES 10000

/* How a call ended. */
typedef enum {
    KERNEL_OK = 0,
    KERNEL_NO_MEMORY = 1,
    KERNEL_NULL = 2,         /* a required array is NULL */
    KERNEL_BAD_COUNT = 3,    /* a count is negative or too large, or a result does not fit into its array */
    KERNEL_BAD_PLANE = 4,    /* unknown projection, or a figure of the earth that is not finite and positive */
    KERNEL_BAD_OFFSET = 5,   /* offsets do not begin at 0, decrease, or do not end at the number of items */
    KERNEL_BAD_PIECE = 6,    /* index of a piece, area, bundle, hull or row out of range */
    KERNEL_BAD_DISTANCE = 7, /* separation or tolerance negative, NaN or infinite */
    KERNEL_BAD_RANGE = 8     /* range of pieces out of range */
} KernelStatus;

/* Return KERNEL_ABI as of the build. */
KERNEL_API int32_t kernel_abi(void);

/* Return the fingerprint of the sources, as given by the build. */
KERNEL_API const char *kernel_fingerprint(void);

/* Free a list that a call allocated. NULL is allowed. */
KERNEL_API void kernel_free(void *list);

/* ---- Scene ------------------------------------------------------------------------------------------------------ */

typedef enum { KERNEL_MERCATOR = 0, KERNEL_GNOMONIC = 1 } KernelProjection;

/* The plane that a scene lies in.
 *
 * Mercator: x = a longitude, y = a psi; legs are rhumb lines on the sphere or on an ellipsoid.
 * Gnomonic about a centre: legs are great circles of the sphere.
 */
typedef struct {
    int32_t projection;  /* KernelProjection */
    int32_t harmonics;   /* terms of to_rectifying and to_conformal: 0 on the sphere */
    double radius_m;     /* radius a of the equator */
    double rectifying_m; /* metres of meridian per radian of rectifying latitude */
    double eccentricity; /* 0 on the sphere */
    double oblateness;   /* ln(largest / smallest radius of the conformal sphere) */
    double to_rectifying[KERNEL_HARMONICS]; /* mu(chi) = chi + sum of c_j sin(2 j chi) */
    double to_conformal[KERNEL_HARMONICS];  /* chi(mu), in the same form */
    double conformal_radius[KERNEL_RADII];  /* metres, power series in sin(chi)^2; on the sphere radius_m, 0, ... */
    double centre_lon_deg, centre_lat_deg;  /* gnomonic only */
} KernelPlane;

/* The pieces of a scene as arrays (conflictdb.arrays.pieces.Pieces). Only read during the call. */
typedef struct {
    int64_t count, vertex_count;
    const int8_t *moves;                       /* (count,) 0: area, shape in plane metres; else haven on a leg */
    const int16_t *turn;                       /* (count,) whole turns of longitude by which the piece is shifted */
    const int64_t *start_us, *end_us;          /* (count,) havens: the slice of the leg */
    const int64_t *leg_start_us, *leg_end_us;  /* (count,) havens: the leg */
    const double *leg_start_deg, *leg_end_deg; /* (count, 2) havens: longitude (continuous across 180) and latitude */
    const double *bearing_deg;                 /* (count,) havens: heading */
    const int64_t *shape_offset; /* (count + 1,) vertices of piece i: [offset[i], offset[i + 1]) */
    const double *shape;         /* (vertex_count, 2) counter-clockwise; havens: metres to starboard and forward */
    const double *shape_to;      /* the shape at the end of the leg; NULL or `shape`: the shape is constant */
    const int8_t *used;          /* (count,) 0: in no pair, not prepared and treated as invalid; NULL: all are used */
} KernelPieces;

/* State of a piece of a scene.
 *
 * Invalid: no vertices, NaN or infinite numbers, a haven of more than KERNEL_MOST_VERTICES, a leg without duration or
 * beyond a pole. */
typedef enum {
    KERNEL_PIECE_INVALID = 0,   /* or not used */
    KERNEL_PIECE_NONCONVEX = 1, /* may lose convexity; its convex hull is used */
    KERNEL_PIECE_CONVEX = 2     /* the vertices stay in convex position */
} KernelState;

typedef struct KernelScene KernelScene;

/* Make a scene: prepare all pieces that are used. */
KERNEL_API KernelStatus kernel_scene_make(const KernelPlane *plane, const KernelPieces *pieces, KernelScene **scene);

/* Free a scene. NULL is allowed. */
KERNEL_API void kernel_scene_free(KernelScene *scene);

/* Return the state of each piece: (pieces,) KernelState. */
KERNEL_API KernelStatus kernel_states(const KernelScene *scene, int8_t *state);

/* Pieces as functions of time. */
typedef struct {
    int64_t count;
    const int64_t *piece;   /* (count,) index of the piece */
    const int64_t *zero_us; /* (count,) the instant that seconds count from */
    const double *origin;   /* (2, count) the plane point that coordinates count from: all x before all y */
} KernelRows;

/* Compute the vertices of rows at times t (count,), to 1e-8 m on the earth.
 *
 * slots : at least the largest number of vertices of these pieces
 * xy : (2, slots, count) plane metres from the origins; pieces of fewer vertices repeat their last one; NaN if invalid
 */
KERNEL_API KernelStatus kernel_positions(const KernelScene *scene, const KernelRows *rows, const double *t, int64_t slots,
                                         double *xy);

/* Compute the reference points of havens at times t (count,), which move on straight lines of the plane.
 *
 * xy : (2, count) plane metres from the origins; NaN for areas and invalid pieces
 */
KERNEL_API KernelStatus kernel_references(const KernelScene *scene, const KernelRows *rows, const double *t, double *xy);

/* Proven bounds on the motion of rows during times [t0, t1], (count,) each; plane metres and seconds. */
typedef struct {
    double *velocity;     /* (2, count) one velocity for the whole polygon, at the middle of the time */
    double *acceleration; /* largest second derivative of a vertex */
    double *spread;       /* largest difference between a vertex' velocity and `velocity` */
    double *deviation;    /* havens: largest distance of a vertex from the convex hull of both end positions; areas: 0 */
    double *scale;        /* havens: most plane metres per metre at a vertex; areas: 1 */
    double *curve;        /* (2, count) second derivative of the reference point at the middle of the time; areas: 0 */
    double *variation;    /* largest difference between a vertex' second derivative and `curve`; areas: 0 */
} KernelBounds;

/* Bound how rows move during [t0, t1], (count,) both, within their slices. Bounds of invalid pieces are NaN. */
KERNEL_API KernelStatus kernel_bounds(const KernelScene *scene, const KernelRows *rows, const double *t0, const double *t1,
                                      const KernelBounds *bounds);

/* Compute the heading of each leg of a track at its start. A leg that stands still keeps the heading at the end of the leg
 * before it, else that of the next leg that moves, else 0.
 *
 * place_deg : (count, 2) waypoints, longitude and latitude; longitudes take the shorter way round
 * bearing_deg : (count - 1,) degrees clockwise from north
 */
KERNEL_API KernelStatus kernel_headings(const KernelPlane *plane, const double *place_deg, int64_t count, double *bearing_deg);

/* Convert places of the plane to degrees.
 *
 * xy : (2, count) plane metres
 * degrees : (count, 2) longitude in [-180, 180) and latitude; NaN for NaN
 */
KERNEL_API KernelStatus kernel_degrees(const KernelPlane *plane, const double *xy, int64_t count, double *degrees);

/* Compute how the corners of a convex outline move when every side moves outward at speed 1. Repeated vertices are one
 * corner. A point becomes the four corners of a square, a line those of a rectangle.
 *
 * outline : (count, 2) vertices in order, without a closing one; count is at least 1
 * corner, rate : room for the larger of count and 4, 2 each: metres, and metres per metre
 * corners : (1,) result: number of corners
 */
KERNEL_API KernelStatus kernel_mitred(const double *outline, int64_t count, double *corner, double *rate, int64_t *corners);

/* ---- Narrow phase ----------------------------------------------------------------------------------------------- */

/* Pairs of pieces and their times. [low_s, high_s] lies within the slices of both pieces. Pairs with an invalid piece, or
 * with seconds that are NaN or beyond KERNEL_LONGEST_S, are KERNEL_UNRESOLVED, NaN or unknown. So are contacts and approaches
 * of pairs with low_s > high_s; the other calls use low_s and high_s as they are. */
typedef struct {
    int64_t count;
    const int64_t *a, *b;          /* (count,) indices of pieces */
    const int64_t *zero_us;        /* (count,) the instant that the seconds of the pair count from */
    const double *low_s, *high_s;  /* (count,) */
} KernelPairs;

/* Verdict on a contact (conflictdb.model.results.Verdict, which adds NEAR). A pair proven apart has no contact. */
typedef enum {
    KERNEL_CONFLICT = 0,  /* the separation is violated, by more than the tolerance at some instant */
    KERNEL_GRAZING = 1,   /* the smallest clearance is within the tolerance of zero: too close to call */
    KERNEL_UNRESOLVED = 2 /* neither contact nor its absence is proven: the time in which contact is possible */
} KernelVerdict;

/* Callback: return where the last (is_last) or first contact of a pair may be between two instants, seconds, or NaN if
 * unknown. It changes the work, not the answer. */
typedef double KernelGuess(void *of, int64_t pair, double low_s, double high_s, int32_t is_last);

/* Options of kernel_contacts. */
typedef struct {
    double separation_m;     /* required separation, metres on the earth; 0: contact means touching */
    double tolerance_m;      /* clearances within the tolerance of zero are too close to call */
    const double *beyond_s;  /* (count,) first instant after the pair's span, which excludes it; infinite: the span
                                includes its last instant; NULL: infinite for all */
    const int64_t *pairs_of_objects; /* (count,) divides the work budget of two objects among their pairs; NULL: 1 each */
    KernelGuess *guess;      /* NULL, or the callback; with it, all pairs are searched */
    void *guess_of;          /* first argument of the callback */
} KernelQuestion;

/* A time during which a pair is in contact, or may be. */
typedef struct {
    int64_t pair;
    double start_s, end_s; /* seconds from the pair's zero; the true contact lies within */
    double error_s;        /* each true end lies at most this far inside */
    int32_t verdict;       /* KernelVerdict */
    int32_t touches;       /* 1: the separation is violated during it, or may be (KERNEL_UNRESOLVED); 0: it is only within
                              the tolerance of that */
} KernelContact;

/* Work counters and seconds by the clock. No answer depends on them. */
typedef struct {
    int64_t closed_forms;   /* pairs decided in closed form (stage 3) */
    int64_t closed_apart;   /* those of them that are apart */
    int64_t windows;        /* times of the other pairs that were bounded; of differences: boxes inspected */
    int64_t evaluations;    /* positions of two polygons computed at an instant */
    int64_t searched_pairs; /* pairs that needed the search by branch and bound */
    double closed_form_s;   /* of the pairs decided in closed form */
    double contacts_s;      /* of all pairs of kernel_contacts */
} KernelWork;

/* Find all contacts of pairs, ordered by pair and time. Work has two budgets, divided among the pairs of two objects
 * (pairs_of_objects), down to a least share: intervals of time in the search, and steps of distances on the earth. When the
 * first is exhausted, the times that are not proven apart by then are reported, as KERNEL_UNRESOLVED or KERNEL_GRAZING, or
 * within a larger error_s. When the second is exhausted, the whole pair is KERNEL_UNRESOLVED.
 *
 * contacts : allocated here, free with kernel_free
 */
KERNEL_API KernelStatus kernel_contacts(const KernelScene *scene, const KernelPairs *pairs, const KernelQuestion *question,
                                        KernelContact **contacts, int64_t *count, KernelWork *work);

/* Compute the meeting point of pairs at low_s: a common point if they overlap, else the middle between their nearest
 * points in the plane.
 *
 * degrees : (count, 2) longitude in [-180, 180) and latitude; NaN for pairs with an invalid piece
 */
KERNEL_API KernelStatus kernel_meetings(const KernelScene *scene, const KernelPairs *pairs, double *degrees);

/* Compute the distance of pairs at low_s: the length of the shortest line on the earth, minus the depth of overlaps.
 *
 * distance_m : (count,) of pairs that are apart never too large; too small by less than the plane's
 *     `distance_error_m`; NaN for pairs with an invalid piece, and if the work budget is exhausted
 */
KERNEL_API KernelStatus kernel_distances(const KernelScene *scene, const KernelPairs *pairs, double *distance_m);

/* Find the least distance of pairs (kernel_distances: minus the depth of overlaps) during [low_s, high_s], where it falls and
 * rises again, as that of two convex pieces in uniform motion does.
 *
 * least_m : (count,) the least that was seen; INFINITY if it is unknown
 * at_s : (count,) when that is
 */
KERNEL_API KernelStatus kernel_deepest(const KernelScene *scene, const KernelPairs *pairs, double *least_m, double *at_s);

/* Groups of pairs, such as all pairs of pieces of two objects: group g has the pairs [offset[g], offset[g + 1]). */
typedef struct {
    int64_t count;
    const int64_t *offset;    /* (count + 1,) */
    const double *limit_m;    /* (count,) distances beyond this need not be known; may be infinite */
    const double *accuracy_m; /* (count,) required accuracy of the distance: coarser takes less work */
} KernelGroups;

/* Find the closest point of approach (CPA) of each group; both ends of a pair's time count.
 *
 * pair : (groups,) the pair that comes closest; -1 if none comes within limit_m (distance_m is infinite), and if the
 *     distance is unknown (distance_m is NaN)
 * at_s : (groups,) seconds of that pair: the earliest instant within 1e-7 m of the minimum; of a touch the first. With
 *     accuracy_m above 2.5e-4: any instant at which the distance is distance_m, to a hundredth of accuracy_m
 * distance_m : (groups,) metres on the earth, 0 for a touch, infinite beyond limit_m; NaN if a piece of the group is
 *     invalid, and if the work budget of distances is exhausted
 * error_m : (groups,) the true minimum lies within distance_m plus or minus this
 * a_deg, b_deg : (groups, 2) longitude in [-180, 180) and latitude of the nearest points of a and of b
 */
KERNEL_API KernelStatus kernel_approaches(const KernelScene *scene, const KernelPairs *pairs, const KernelGroups *groups,
                                          int64_t *pair, double *at_s, double *distance_m, double *error_m, double *a_deg,
                                          double *b_deg, KernelWork *work);

/* Pairs of pieces, each piece with a time and a zero of its own, as one may be shifted against the other. Pieces that
 * stand still need no time: an empty one, [0, 0], gives the contacts of the other piece. Pairs with an invalid piece or
 * time are KERNEL_DIFFERENCE_UNKNOWN. */
typedef struct {
    int64_t count, is_factor;                 /* the goal of all pairs: 0: differences; else factors */
    const int64_t *a, *b;                     /* (count,) indices of pieces */
    const int64_t *a_zero_us, *b_zero_us;     /* (count,) the instants that the seconds of a and of b count from */
    const double *a_start_s, *a_end_s;        /* (count,) times within the slices of the pieces */
    const double *b_start_s, *b_end_s;
    const double *least, *most;               /* (count,) asked about: differences, infinite: all; or factors */
    const double *weight;                     /* (count,) of the seconds of a in a difference; NULL: 1 */
} KernelShifts;

/* What is proven about the differences of a pair. */
typedef enum {
    KERNEL_DIFFERENCE_NONE = 0,   /* nothing asked about brings it into contact */
    KERNEL_DIFFERENCE_INNER = 1,  /* contact at each one of the inner interval, at none outside of the outer */
    KERNEL_DIFFERENCE_OUTER = 2,  /* no contact outside of the outer interval; the inner one is empty */
    KERNEL_DIFFERENCE_UNKNOWN = 3 /* nothing: the outer interval has all that both times allow, or all asked about */
} KernelDifferenceState;

/* Values of the goal at which the pieces come within reach of each other: seconds of b minus `weight` times seconds of a;
 * or factors, seconds of b by seconds of a. An empty interval is [INFINITY, -INFINITY]. At an inner interval, the times of
 * the contacts at both of its ends, which a way of contacts connects. */
typedef struct {
    double outer_low, inner_low, inner_high, outer_high;
    int32_t state; /* KernelDifferenceState */
    double low_a_s, low_b_s, high_a_s, high_b_s;
} KernelDifference;

/* A part of the times of a pair that has a difference. */
typedef struct {
    int64_t pair;
    double a_start_s, a_end_s, b_start_s, b_end_s;
    KernelDifference found;
} KernelDifferencePart;

/* Find the differences of departure, or the factors of time, that bring pairs within reach_m of each other on the earth (0:
 * touching).
 *
 * If a departs d later, and b as planned, they meet if and only if d is a difference, plus b_zero_us minus a_zero_us. If all
 * times of a since the instant a_zero_us = b_zero_us take k times as long, they meet if and only if k is a factor: outer
 * intervals hold also if the instants of waypoints are rounded to microseconds, inner ones if they are not. If a and b take
 * i and k times as long, they meet if and only if the difference of departures is k times one of weight i / k. Seconds of a are
 * not negative then, and factors asked about are positive and finite. The work for a pair is bounded; when its budget is
 * exhausted, its outer interval is larger than need be.
 *
 * found : (count,)
 */
KERNEL_API KernelStatus kernel_differences(const KernelScene *scene, const KernelShifts *shifts, double reach_m,
                                           KernelDifference *found, KernelWork *work);

/* The same in parts, ordered by pair: contact sets of havens that change their shape may have several. Times are halved
 * where more than a second of a difference is neither proven free nor forbidden. Pairs without a contact have no part.
 *
 * parts : allocated here, free with kernel_free
 */
KERNEL_API KernelStatus kernel_difference_parts(const KernelScene *scene, const KernelShifts *shifts, double reach_m,
                                                KernelDifferencePart **parts, int64_t *count, KernelWork *work);

/* Heights of pieces, linear in time along their legs. */
typedef struct {
    int64_t count;
    const double *climb_m;                    /* (count, 4) floor at the start and the end of the leg, then the ceilings;
                                                 NULL: floor_m and ceiling_m all the time */
    const double *floor_m, *ceiling_m;        /* (count,) the lowest and the highest of the piece */
    const int64_t *start_us, *end_us;         /* (count,) the piece */
    const int64_t *leg_start_us, *leg_end_us; /* (count,) the leg */
} KernelHeights;

/* Compute when the heights of pairs overlap during the time that both pieces share.
 *
 * a, b : (count,) indices of pieces
 * first_s, last_s : (count,) seconds from the start of that time; first > last: never. -INFINITY and INFINITY if neither
 *     climbs
 * error_s : (count,) by how much each end may be too early or too late
 */
KERNEL_API KernelStatus kernel_height_overlaps(const KernelHeights *pieces, const int64_t *a, const int64_t *b, int64_t count,
                                               double *first_s, double *last_s, double *error_s);

/* Cut the times of both pieces of shifts to when their heights may overlap at any time of the other one. If only one climbs,
 * they overlap at exactly these times; two that climb may still miss each other.
 *
 * a_start_s, a_end_s, b_start_s, b_end_s : (count,) results; start > end: never
 * doubt_s : (count,) result: errors of these ends; infinite if heights are not known to overlap at them
 */
KERNEL_API KernelStatus kernel_level_shifts(const KernelHeights *pieces, const KernelShifts *shifts, double *a_start_s,
                                            double *a_end_s, double *b_start_s, double *b_end_s, double *doubt_s);

/* A step of a proof that a pair is apart: from the step before, or the pair's low_s, until this. NaN: not proven. */
typedef struct {
    int64_t pair;
    double until_s; /* seconds from the pair's zero; of the last step high_s */
    double angle;   /* of the direction from a to b that keeps them apart, radians counter-clockwise from the plane's x */
} KernelDirection;

/* Find directions that prove pairs farther apart than separation_m, as docs/reference/proof.md states it; ordered by pair
 * and time. Where a pair is apart by less than two micrometres, and next to contacts, nothing is proven. Work for a pair is
 * bounded. Pairs with an invalid piece, and those with a separation of more than 600 km, have one step, not proven.
 *
 * directions : allocated here, free with kernel_free
 */
KERNEL_API KernelStatus kernel_directions(const KernelScene *scene, const KernelPairs *pairs, double separation_m,
                                          KernelDirection **directions, int64_t *count, KernelWork *work);

/* Bound rows during [t0, t1], (count,) both, by the boxes of docs/reference/proof.md: two rows whose boxes do not meet are
 * farther apart than separation_m.
 *
 * box : (count, 4) min x, min y, max x, max y, plane metres from the origins; NaN if invalid
 */
KERNEL_API KernelStatus kernel_proof_boxes(const KernelScene *scene, const KernelRows *rows, const double *t0, const double *t1,
                                           double separation_m, double *box);

/* Pairs of pieces of tracks that are asked for uses of one place. */
typedef struct {
    int64_t count, within_us; /* T: how far apart in time */
    double separation_m, tolerance_m;
    const int64_t *a, *b; /* (count,) indices of pieces */
} KernelUsesAsked;

/* A use of one place by two pieces within T. */
typedef struct {
    int64_t a_start_us, a_end_us, b_start_us, b_end_us; /* when each is at a place that the other uses within T, as outer
                                                           bounds; KERNEL_MINUS_INFINITY_US and KERNEL_INFINITY_US where
                                                           unbounded */
    double error_s;                    /* each end lies at most this far outside of the true one */
    double lacking_s, lacking_error_s; /* at most so much of T is missed, and how much less it may be; NaN if unknown */
    double first_lon_deg, first_lat_deg; /* where it begins; NaN if unknown */
    int32_t verdict, touches;            /* as KernelContact */
    int32_t is_use;                      /* 0: the pair has none */
} KernelUse;

/* Find the uses of one place by pairs of tracks within T: A at u and B at v come within the separation, or the tolerance of
 * it, for instants u and v at most T apart. One use a pair at most.
 *
 * pieces : those of the scene
 * uses : (count,)
 */
KERNEL_API KernelStatus kernel_uses(const KernelScene *scene, const KernelHeights *pieces, const KernelUsesAsked *asked,
                                    KernelUse *uses, KernelWork *work);

/* Whether pairs come within a reach at instants at most T apart. */
enum { KERNEL_NEAR_NONE = 0, KERNEL_NEAR_POSSIBLE = 1, KERNEL_NEAR_SURE = 2 };

/* Decide whether pairs come within reach_m of each other at instants at most within_us apart. Shifts are asked about
 * differences of the same time or less.
 *
 * near : (count,) KERNEL_NEAR_NONE if it is proven that they do not, KERNEL_NEAR_SURE if it is proven that they do
 */
KERNEL_API KernelStatus kernel_near_in_time(const KernelScene *scene, const KernelShifts *shifts, double reach_m,
                                            int64_t within_us, int8_t *near, KernelWork *work);

/* What is known of a use: verdict and touches, and what follows. */
enum {
    KERNEL_USE_OF_SPANS = 0,  /* it lasts while both pieces are near in time: of areas, or undecided */
    KERNEL_USE_OF_AREA_A = 1, /* error_s, and when b is in a (KernelUsed: start_s, end_s) */
    KERNEL_USE_OF_AREA_B = 2, /* error_s, and when a is in b */
    KERNEL_USE_OF_TRACKS = 3  /* all (kernel_uses) */
};

/* Contacts as uses of one place. */
typedef struct {
    int64_t count, within_us;
    const int64_t *a_start_us, *a_end_us, *b_start_us, *b_end_us; /* (count,) spans of both pieces */
    const int8_t *known;                                          /* (count,) what is known of each use */
    const double *start_s, *end_s; /* (count,) contact of a track with an area that is there T longer at both ends: seconds of
                                      the time that they share so; NULL if none is */
} KernelUsed;

/* Complete uses. One that ends before it starts becomes KERNEL_UNRESOLVED while both pieces are near in time. uses : (count,) */
KERNEL_API KernelStatus kernel_use_times(const KernelUsed *asked, KernelUse *uses);

/* Contacts of pairs of pieces, each of a group: the pairs of two objects. Those that end before they start become
 * KERNEL_UNRESOLVED during their whole shared time. */
typedef struct {
    int64_t count, groups;
    const int64_t *group;                           /* (count,) */
    const int64_t *shared_start_us, *shared_end_us; /* (count,) the time that both pieces share */
    double *start_s, *end_s, *error_s;              /* (count,) seconds of it, as KernelContact */
    int8_t *verdict;                                /* (count,) KernelVerdict */
    uint8_t *touches;                               /* (count,) */
    const double *lacking_s, *lacking_error_s;      /* (count,) as KernelUse; NULL: no separation in time */
} KernelTouching;

/* The periods of groups. */
typedef struct {
    int64_t *start_us, *end_us;          /* (count,) contacts as instants, rounded outward to the microsecond */
    int64_t *order, *order_offset; /* (count,), (groups + 1,) contacts that are reported, by group, start and end. If two
                                            objects touch, those that only come within the tolerance are left out */
    int64_t *period_us, *period_offset; /* (count, 2), (groups + 1,) start and end; disjoint, in order */
    double *time_error_s; /* (groups,) each end of a period is off by at most this */
    int8_t *verdict; /* (groups,) of reported contacts: the gravest KernelVerdict */
    uint8_t *is_open, *meets; /* (groups,) whether a reported one is unresolved, and whether any touches */
    double *lacking_s, *lacking_error_s; /* (groups,) the most that is lacking, NaN if unknown; or NULL */
} KernelMerged;

/* Merge contacts into the periods of pairs of objects. */
KERNEL_API KernelStatus kernel_merge(const KernelTouching *contacts, const KernelMerged *merged);

/* Areas of the plane: closed rings one after the other, plane metres. */
typedef struct {
    int64_t count, ring_count, vertex_count;
    const double *ring; /* (vertex_count, 2) */
    const int64_t *ring_offset; /* (ring_count + 1,) vertices of ring r: [offset[r], offset[r + 1]) */
    const int64_t *area_offset; /* (count + 1,) rings of area k */
    const double *margin; /* (count,) places farther than this from the border are deep, plane metres */
} KernelAreas;

/* Depth of a pair in an area. */
typedef enum { KERNEL_SHALLOW = 0, KERNEL_DEEP = 1, KERNEL_DEPTH_UNKNOWN = 2 } KernelDepth;

/* Decide whether the intersection of a pair reaches deeper than a margin into an area, of which one piece is a convex
 * part: at low_s, in the middle of the time, and at high_s.
 *
 * area, is_b : (count,) the area, and which piece is its part: 0: a, else b
 * east_m : (count,) how far east of the area the part lies (seam copies lie whole turns away), plane metres
 * depth : (count,) KernelDepth. Depths that exceed the margin by less than a thousandth may be reported as shallow.
 *     Unknown: a piece is invalid, the area has no sides or non-finite ones, the margin is negative or NaN, or the work
 *     budget is exhausted
 */
KERNEL_API KernelStatus kernel_whole_depths(const KernelScene *scene, const KernelPairs *pairs, const KernelAreas *areas,
                                            const int64_t *area, const int8_t *is_b, const double *east_m, int8_t *depth);

/* ---- Regions ---------------------------------------------------------------------------------------------------- */

/* Kind of the region of a pair. */
typedef enum {
    KERNEL_REGION_UNKNOWN = 0, /* no region: a piece is invalid, or the region goes around the earth */
    KERNEL_REGION_SWEPT = 1, /* intersection of the swept hulls: a superset */
    KERNEL_REGION_COMMON = 2 /* intersection of two pieces that stand still */
} KernelRegion;

/* Compute where pairs come within reach_m of each other during [low_s, high_s], or may: the intersection of both swept
 * hulls, each grown by half of reach_m. For two overlapping pieces that stand still it is their intersection. Regions no
 * wider than a micrometre are empty.
 *
 * ring : (REGION_PER_VERTEX v + REGION_MORE count, 2) v the vertices of all pieces of the pairs: closed rings in plane
 *     metres, within half a turn of a Mercator plane, counter-clockwise
 * ring_offset : (2 count + 1,) rings 2 i and 2 i + 1 of pair i, the second for a region that crosses the antimeridian.
 *     Both are empty if the pair does not come that close.
 * what : (count,) KernelRegion
 */
KERNEL_API KernelStatus kernel_regions(const KernelScene *scene, const KernelPairs *pairs, double reach_m, double *ring,
                                       int64_t *ring_offset, int8_t *what);

/* Regions of the plane as rings: region i has the rings [offset[i], offset[i + 1]). */
typedef struct {
    int64_t count, ring_count, vertex_count;
    const double *vertex;       /* (vertex_count, 2) closed, plane metres: in a Mercator plane within half a turn */
    const int64_t *ring_offset; /* (ring_count + 1,) */
    const int64_t *offset;      /* (count + 1,) */
    const int8_t *is_hole;      /* (ring_count,) holes, clockwise, follow their shells, counter-clockwise. NULL: all rings are
                                   convex and counter-clockwise, and a region is their union */
} KernelRings;

/* What is known of a region in longitude and latitude. */
typedef enum {
    KERNEL_OUTLINE_UNKNOWN = 0, /* not written: it reaches a pole, or is no wider than rounding */
    KERNEL_OUTLINE_SOUND = 1,   /* valid, within 180 degrees of longitude, and the place is inside */
    KERNEL_OUTLINE_AWAY = 2,    /* valid, but the place is not certainly inside */
    KERNEL_OUTLINE_CROSSED = 3, /* its sides may cross or touch; not written if rings could not be united */
    KERNEL_OUTLINE_BEYOND = 4   /* it reaches beyond 180 degrees of longitude; its sides may cross */
} KernelOutline;

/* Write regions as polygons and multipolygons in longitude and latitude, degrees. Each contains all places of its rings,
 * and reaches beyond them by at most limit_m on the earth, unless a ring has more than some 20,000 corners.
 *
 * limit_m : 0.01 to 100,000
 * place : (count, 2) longitude and latitude of a place that each should contain; NaN: none. NULL: none at all
 * bytes, byte_offset : (room,), (count + 1,) EWKB: bytes[byte_offset[i]] to byte_offset[i + 1]; empty if not written
 * what : (count,) KernelOutline
 * done : the number of regions written, fewer than count if `room` is too small for the next
 */
KERNEL_API KernelStatus kernel_outlines(const KernelPlane *plane, const KernelRings *rings, double limit_m, const double *place,
                                        uint8_t *bytes, int64_t room, int64_t *byte_offset, int8_t *what, int64_t *done);

/* Merge consecutive convex rings of one group while their hull exceeds their union by at most a tenth. The results need
 * at most as many rings and vertices as the input.
 *
 * ring, ring_offset, group : (vertex_count, 2), (count + 1,), (count,) closed, counter-clockwise; rings of fewer than
 *     three corners are skipped
 * joined_ring, joined_offset, joined_group : (w, 2), (joined_count + 1,), (joined_count,) closed, counter-clockwise
 */
KERNEL_API KernelStatus kernel_joined(const double *ring, int64_t vertex_count, const int64_t *ring_offset,
                                      const int64_t *group, int64_t count, double *joined_ring, int64_t *joined_offset,
                                      int64_t *joined_group, int64_t *joined_count);

/* Merge the triangles of polygons into convex parts, across shared sides.
 *
 * triangle : (count, 3, 2) corners, counter-clockwise
 * of : (count,) polygon of each triangle; triangles of a polygon are consecutive
 * corner : (3 count,) result: corners of the parts, part after part, as rows of all corners (3 count, 2)
 * offset : (count + 1,) result: where the corners of each part begin, and the last end
 * parts : (1,) result: number of parts
 */
KERNEL_API KernelStatus kernel_convex_parts(const double *triangle, const int64_t *of, int64_t count, int64_t *corner,
                                            int64_t *offset, int64_t *parts);

/* ---- Broad phase ------------------------------------------------------------------------------------------------ */

/* Two steps: kernel_box_pairs joins rows (bundles of pieces), unless the database's index does; then kernel_bundled_pairs
 * joins the pieces of each pair of rows. */

/* Compute padded swept hulls of the pieces [first, end): each contains its piece during its whole time, padded by half of
 * reach_m, so that the hulls of two pieces intersect wherever the pieces come within reach_m of each other.
 *
 * The hull of a haven covers its positions at both ends of its slice, and the deviation of the vertices in between. It is
 * grown by squares: half of reach_m at the largest scale of the piece. Where two grown edges meet within 2.5 paddings
 * along either axis, their corner replaces the squares' corners.
 *
 * hull : (HULL_PER_VERTEX v + HULL_MORE (end - first), 2) plane metres, v the vertices of these pieces: closed rings one
 *     after the other, counter-clockwise
 * hull_offset : (end - first + 1,) ring i: [offset[i], offset[i + 1]); empty if the piece is invalid
 * deviation : (end - first,) largest distance of a vertex from the hull of the slice's ends, plane metres; NaN if invalid
 * reach : (end - first,) largest distance of a vertex from the reference point at the ends of the slice, plane metres;
 *     0 for areas
 */
KERNEL_API KernelStatus kernel_hulls(const KernelPlane *plane, const KernelPieces *pieces, int64_t first, int64_t end,
                                     double reach_m, double *hull, int64_t *hull_offset, double *deviation, double *reach);

/* Decide which hulls of pairs are disjoint. 1 is proven for any rings. 0 means, for convex counter-clockwise rings, that
 * they intersect, to rounding.
 *
 * hull, hull_offset : (vertex_count, 2), (hull_count + 1,) closed rings of kernel_hulls, plane metres; an empty ring is
 *     never disjoint
 * a, b : (count,) indices of hulls
 * apart : (count,) 1 or 0
 */
KERNEL_API KernelStatus kernel_apart(const double *hull, int64_t vertex_count, const int64_t *hull_offset, int64_t hull_count,
                                     const int64_t *a, const int64_t *b, int64_t count, uint8_t *apart);

/* Group the pieces of objects into bundles, which are stored and looked up as one row.
 *
 * boxes : (count, 4) min x, min y, max x, max y of hulls, plane metres
 * run : (count,) consecutive pieces of the same number may share a bundle
 * moves : (count,) 0: part of an area; 1: slice of a track (slices are in order of time, and stay so)
 * order : (count,) result: the pieces, those of a bundle consecutive and in their given order
 * begins : (count,) result: 1 where a bundle begins in that order, else 0
 */
KERNEL_API KernelStatus kernel_bundles(const double *boxes, const int64_t *run, const uint8_t *moves, int64_t count,
                                       int64_t *order, uint8_t *begins);

/* The numbers that rows have: IN_PIECES of conflictdb/arrays/column_numbers.py. */
#define KERNEL_NUMBERS 2

/* Bounding boxes of rows: in the plane, in height and in time. */
typedef struct {
    int64_t count;
    const double *boxes; /* (count, 4) min x, min y, max x, max y */
    const double *floor_m; /* (count,) heights of rows overlap if they share more than an end */
    const double *ceiling_m; /* (count,) */
    const int64_t *start_us; /* (count,) */
    const int64_t *end_us; /* (count,) */
    const int64_t *object; /* (count,) number of the row's object */
    const uint8_t *is_copy; /* (count,) 1: seam copy; two copies intersect where their originals do, and are no pair */
    const uint8_t *end_inclusive; /* (count,) 1: end_us belongs to the row; NULL: all do */
    const int64_t *numbers; /* (count, KERNEL_NUMBERS) what objects have that may_meet.h compares; NULL: not compared */
    const int64_t *type; /* (count,) types of objects: kind and class; NULL if all types are compared */
} KernelBoxes;

/* Which pairs of rows may meet. */
typedef struct {
    int64_t within_us; /* rows that are at most so far apart in time */
    int64_t type_count; /* number of types */
    const uint8_t *of_types; /* (type_count, type_count) 1: objects of two types are compared; NULL: all are */
} KernelCompared;

/* Say which pairs of rows of different objects may meet, by boxes, times, heights, seam copies, numbers and types.
 *
 * rows, others : without boxes (NULL), boxes are not compared; objects are not read
 * a, b : (count,) indices of rows, and of others
 * may_meet : (count,) result: 1 or 0
 */
KERNEL_API KernelStatus kernel_may_meet(const KernelBoxes *rows, const KernelBoxes *others, const KernelCompared *compared,
                                        const int64_t *a, const int64_t *b, int64_t count, uint8_t *may_meet);

/* Order rows so that neighbours in space and time are neighbours in the order. order : (count,) result */
KERNEL_API KernelStatus kernel_box_order(const KernelBoxes *rows, int64_t *order);

/* Find the pairs of pieces, of pairs of bundles, that may meet (kernel_may_meet).
 *
 * pieces : each bundle in order of time; the parts of an area have equal times
 * offset : (bundles + 1,) where the pieces of each bundle begin, and the last end
 * a, b : (count,) indices of bundles
 * first, second : (room,) result: pieces of a and of b, in the order of the pairs of bundles. KERNEL_BAD_COUNT if room is
 *     too small; the number of all pairs of their pieces is always enough
 * found : (1,) result: number of pairs
 */
KERNEL_API KernelStatus kernel_bundled_pairs(const KernelBoxes *pieces, const int64_t *offset, int64_t bundles,
                                             const KernelCompared *compared, const int64_t *a, const int64_t *b, int64_t count,
                                             int64_t *first, int64_t *second, int64_t room, int64_t *found);

/* Find the rows that may meet given rows (kernel_may_meet), and whose object has a larger number.
 *
 * rows : in the order of kernel_box_order; any other order gives the same pairs, more slowly
 * of : (wanted,) indices of the given rows, those of an object consecutive
 * first, second : (room,) result: pairs of rows, in the order of `of`
 * done : (1,) result: how many rows of `of` are complete; objects whose pairs did not fit are left out
 * found : (1,) result: number of pairs
 * looked_at : (1,) result: number of compared boxes, of rows and of tree nodes
 */
KERNEL_API KernelStatus kernel_box_pairs(const KernelBoxes *rows, const KernelCompared *compared, const int64_t *of,
                                         int64_t wanted, int64_t *first, int64_t *second, int64_t room, int64_t *done,
                                         int64_t *found, int64_t *looked_at);

/* Rows that stay, for lookups of others; immutable, so threads may share it. */
typedef struct KernelBoxTree KernelBoxTree;

/* Copy rows into a tree; free it with kernel_box_tree_free. tree : (1,) result */
KERNEL_API KernelStatus kernel_box_tree_make(const KernelBoxes *rows, KernelBoxTree **tree);
KERNEL_API void kernel_box_tree_free(KernelBoxTree *tree);

/* Find the rows of a tree that may meet given rows (kernel_may_meet), of any object.
 *
 * first, second : (room,) result: given rows in their order, and rows of the tree by the numbers they were made with
 * found : (1,) result: number of pairs; if it exceeds room, only as many are written
 */
KERNEL_API KernelStatus kernel_box_tree_pairs(const KernelBoxTree *tree, const KernelBoxes *rows,
                                              const KernelCompared *compared, int64_t *first, int64_t *second, int64_t room,
                                              int64_t *found);

/* ---- Bytes ------------------------------------------------------------------------------------------------------ */

/* Read the rings of polygons and multipolygons without holes from well-known binary (WKB).
 *
 * wkb, offset : (size,), (count + 1,) little-endian bytes of all shapes, and where each begins, and the last ends
 * xy : (vertex_room, 2) result: vertices of all rings; size / 16 is always enough
 * ring_offset : (rings + 1,) result: where the vertices of each ring begin, and the last end
 * rings : expected number of rings; another number, or another type of shape, is KERNEL_BAD_COUNT
 */
KERNEL_API KernelStatus kernel_wkb_rings(const uint8_t *wkb, int64_t size, const int64_t *offset, int64_t count, double *xy,
                                         int64_t vertex_room, int64_t *ring_offset, int64_t rings);

/* One column of rows of bytes: of constant width, or ragged. */
typedef struct {
    const uint8_t *data;
    int64_t size; /* bytes of data */
    const int64_t *offset; /* (count + 1,) where each row begins in data, and the last ends; NULL: constant width */
    int64_t width; /* bytes per row, if offset is NULL */
} KernelPart;

/* Concatenate rows: for each row its parts in order. rows : (size,) result; all of it is filled */
KERNEL_API KernelStatus kernel_interleave(const KernelPart *parts, int64_t part_count, int64_t count, uint8_t *rows,
                                          int64_t size);

/* Compute a digest of each row (its parts in order) by SipHash-2-4. key : (2,) words; digest : (count,) result */
KERNEL_API KernelStatus kernel_digests(const KernelPart *parts, int64_t part_count, int64_t count, const uint64_t *key,
                                       uint64_t *digest);

#endif
