/* When two moving polygons touch, or come nearer to each other than a distance: one pair at a time, with proofs.
 *
 * Two pieces of a scene are convex polygons that stand still, or ride along a leg as havens. For a pair of them during
 * [low_s, high_s] the kernel tells every contact, and proves that there is no other, or says that it could not
 * (KernelVerdict). What is proven holds for the motion itself: no step samples, and rounding is allowed for.
 * docs/explanation/kernel.md says how.
 *
 * Units are metres, seconds and degrees at this border; "plane metres" are coordinates of the plane in which the legs
 * and edges are straight. Instants are microseconds since 1970.
 *
 * Nothing is global: a KernelScene is made once, is not changed after that, and may be used by any number of threads.
 * What a call answers for a pair depends on that pair alone. Every index is checked here, at the border; memory is
 * taken here and nowhere else. Numbers that are no numbers are no error: what they belong to is undecided.
 */
#ifndef CONFLICTDB_KERNEL_H
#define CONFLICTDB_KERNEL_H

#include <stdint.h>

/* Changes with every change of a structure, a constant or a function of this file. */
#define KERNEL_ABI 19

/* Polygons this close touch, metres on the earth: coordinates are rounded to 1e-8 m, and a touch must not become a
 * miss. Larger: ends are wider than they need to be. Smaller: rounding decides. */
#define KERNEL_TOUCH_M 5e-8

/* Hulls are padded by this beyond all else, metres: plane coordinates reach 4e7 m, where doubles are 7.5e-9 m apart, and
 * a vertex is a sum of about ten of them. Larger: more pairs. Smaller: rounding may take a touch away. */
#define KERNEL_ROUNDING_M 1e-6

/* A padded hull of a piece of n vertices has at most HULL_PER_VERTEX n + HULL_MORE, its first again at its end. */
#define KERNEL_HULL_PER_VERTEX 6
#define KERNEL_HULL_MORE 5

/* The rings of the region of two pieces of n vertices together have at most REGION_PER_VERTEX n + REGION_MORE vertices. */
#define KERNEL_REGION_PER_VERTEX 8
#define KERNEL_REGION_MORE 8

/* Coefficients of the longest series of a figure of the earth. */
#define KERNEL_HARMONICS 6
#define KERNEL_RADII 7

/* Instants lie between plus and minus this, microseconds, so that differences of two fit into 64 bits. */
#define KERNEL_LATEST_US (INT64_C(1) << 61)

/* Seconds of a pair lie between plus and minus this: no two instants of 64 bits are further apart. */
#define KERNEL_LONGEST_S (0x1p64 / 1e6)

/* A haven of more vertices is a piece that cannot be: the time that its pairs take grows with the square of the number, to
 * half a second each. Areas have no such limit: of what stands still only its own edges count. */
#define KERNEL_MOST_VERTICES 10000

/* How a call ended. */
typedef enum {
    KERNEL_OK = 0,
    KERNEL_NO_MEMORY = 1,
    KERNEL_NULL = 2,        /* an array is missing */
    KERNEL_BAD_COUNT = 3,   /* a count is negative */
    KERNEL_BAD_PLANE = 4,   /* no such plane, or an earth of no size */
    KERNEL_BAD_OFFSET = 5,  /* the offsets of vertices do not begin at 0, decrease, or end beyond the vertices */
    KERNEL_BAD_PIECE = 6,   /* the number of a pair's piece is none of the scene's */
    KERNEL_BAD_DISTANCE = 7, /* a separation or tolerance that is negative or no number */
    KERNEL_BAD_RANGE = 8     /* a range of pieces that is not within them */
} KernelStatus;

/* What is known of a contact (conflictdb.results.Verdict). */
typedef enum {
    KERNEL_CONFLICT = 0,  /* nearer than wanted, by more than the tolerance at some instant */
    KERNEL_GRAZING = 1,   /* the least clearance is within the tolerance of zero: too close to call */
    KERNEL_UNRESOLVED = 2 /* neither is proven, nor that they stay apart: the time in which they might meet */
} KernelVerdict;

typedef enum { KERNEL_MERCATOR = 0, KERNEL_GNOMONIC = 1 } KernelProjection;

/* The plane that a scene lies in.
 *
 * Mercator: x = a longitude, y = a psi; legs are rhumb lines on the sphere or on an ellipsoid.
 * Gnomonic about a centre: legs are great circles of the sphere.
 */
typedef struct {
    int32_t projection;    /* KernelProjection */
    int32_t harmonics;     /* terms of to_rectifying and to_conformal: 0 on the sphere */
    double radius_m;       /* of the equator, a */
    double rectifying_m;   /* metres of meridian per radian of rectifying latitude */
    double eccentricity;   /* 0 on the sphere */
    double oblateness;     /* ln(largest / least radius of the conformal sphere) */
    double to_rectifying[KERNEL_HARMONICS];  /* mu(chi) = chi + sum of c_j sin(2 j chi) */
    double to_conformal[KERNEL_HARMONICS];   /* chi(mu), the same way */
    double conformal_radius[KERNEL_RADII];   /* metres, power series in sin(chi)^2; on the sphere radius_m, 0, ... */
    double centre_lon_deg, centre_lat_deg;   /* gnomonic only */
} KernelPlane;

/* The pieces of a scene, as arrays (conflictdb.arrays.pieces.Pieces); only read while the scene is made. */
typedef struct {
    int64_t count, vertex_count;
    const int8_t *moves;          /* (count,) 0: an area, whose shape is in plane metres; else a haven on a leg */
    const int16_t *turn;          /* (count,) whole turns of longitude by which a piece is shifted */
    const int64_t *start_us, *end_us;          /* (count,) havens: the slice of the leg */
    const int64_t *leg_start_us, *leg_end_us;  /* (count,) havens: the leg */
    const double *leg_start_deg, *leg_end_deg; /* (count, 2) havens: longitude, which runs on, and latitude */
    const double *bearing_deg;                 /* (count,) havens: the heading */
    const int64_t *shape_offset;  /* (count + 1,) vertices of piece i: [offset[i], offset[i + 1]) */
    const double *shape;          /* (vertex_count, 2) counter-clockwise; havens: starboard and forward, metres */
    const double *shape_to;       /* the same at the end of the leg; NULL or `shape` where nothing changes */
    const int8_t *wanted;         /* (count,) 0: no pair has this piece, which costs nothing then; NULL: all are wanted */
} KernelPieces;

/* Pairs of pieces: numbers, the instant that the pair counts its seconds from, and its time. Both pieces must be there
 * throughout: [low_s, high_s] lies within both slices. Of a pair whose seconds lie beyond KERNEL_LONGEST_S nothing is known,
 * as of one with a piece that cannot be. */
typedef struct {
    int64_t count;
    const int64_t *a, *b;
    const int64_t *zero_us;
    const double *low_s, *high_s;
} KernelPairs;

/* Tell where the extreme contact of a pair may be, the last or the first one between two instants, seconds; NaN where it
 * is not known. What is told decides the work alone, no answer. */
typedef double KernelGuess(void *of, int64_t pair, double low_s, double high_s, int32_t is_last);

/* What is asked about pairs. */
typedef struct {
    double separation_m;     /* the distance wanted on the earth; where it is 0, contact is touching */
    double tolerance_m;      /* closeness that is too close to call */
    const double *beyond_s;  /* (count,) the first instant that is no longer in a pair's span, infinite where the last one
                                is; NULL: infinite for all */
    const int64_t *company;  /* (count,) how many pairs share the work that may be done for two objects; NULL: 1 each */
    KernelGuess *guess;      /* NULL, or whom to ask; then all pairs are searched */
    void *guess_of;
} KernelQuestion;

/* A time during which a pair is in contact, or might be. */
typedef struct {
    int64_t pair;
    double start_s, end_s; /* seconds from the pair's zero; the true contact lies within */
    double error_s;        /* by which either true end may lie inside, at most */
    int32_t verdict;       /* KernelVerdict */
    int32_t touches;       /* whether they are nearer than wanted during it, not only within the tolerance of that */
} KernelContact;

/* What was done: pairs decided in closed form (stage 3), and how many of these are apart; windows of the other pairs,
 * evaluations of two polygons at an instant, and pairs searched by branch and bound. And seconds by the clock: of the pairs
 * decided in closed form, and of all pairs of kernel_contacts. No answer depends on these. */
typedef struct {
    int64_t closed_forms, closed_apart, windows, evaluations, searched_pairs;
    double closed_form_s, contacts_s;
} KernelWork;

/* Pieces as functions of time: numbers, the instant that each counts its seconds from, and the plane point that it counts
 * its coordinates from, (2, count): all x before all y. */
typedef struct {
    int64_t count;
    const int64_t *piece;
    const int64_t *zero_us;
    const double *origin;
} KernelRows;

/* What is promised of rows during times [t0, t1], (count,) each; plane metres and seconds. */
typedef struct {
    double *velocity;     /* (2, count) one velocity for the whole polygon, in the middle of the time */
    double *acceleration; /* no vertex has a larger second derivative */
    double *spread;       /* no vertex has a velocity further from that */
    double *deviation;    /* havens: no vertex is further outside of the hull of the ends; of areas 0 */
    double *scale;        /* havens: no vertex has more plane metres per metre; of areas 1 */
    double *curve;        /* (2, count) the second derivative of the reference point in the middle of the time; of areas 0 */
    double *variation;    /* no vertex has a second derivative further from that; of areas 0 */
} KernelBounds;

/* What a piece of a scene is. */
typedef enum {
    KERNEL_CANNOT_BE = 0, /* or is not wanted */
    KERNEL_MAY_DENT = 1,  /* the hull of its vertices is meant */
    KERNEL_CONVEX = 2     /* its vertices stay in convex position */
} KernelState;

/* Groups of pairs: those of group g are [offset[g], offset[g + 1]). */
typedef struct {
    int64_t count;
    const int64_t *offset;  /* (count + 1,) */
    const double *wanted_m; /* (count,) the distance beyond which nothing needs to be known; may be infinite */
    const double *aim_m;    /* (count,) how well the distance needs to be known: coarser takes less work */
} KernelGroups;

/* Areas of the plane: rings one after the other, plane metres, each with its first vertex again at its end. */
typedef struct {
    int64_t count, ring_count, vertex_count;
    const double *ring;         /* (vertex_count, 2) */
    const int64_t *ring_offset; /* (ring_count + 1,) vertices of ring r: [offset[r], offset[r + 1]) */
    const int64_t *area_offset; /* (count + 1,) rings of area k */
    const double *margin;       /* (count,) what is further from the border is deep, plane metres */
} KernelAreas;

/* Whether a pair is seen to be deep in an area. */
/* What is told of where a pair meets: nothing, where a piece cannot be or goes around the earth; what both sweep; what two
 * that stand still have in common. */
typedef enum { KERNEL_REGION_UNKNOWN = 0, KERNEL_REGION_SWEPT = 1, KERNEL_REGION_COMMON = 2 } KernelRegion;

typedef enum { KERNEL_SHALLOW = 0, KERNEL_DEEP = 1, KERNEL_DEPTH_UNKNOWN = 2 } KernelDepth;

typedef struct KernelScene KernelScene;

/* Return KERNEL_ABI, as the library was built with. */
int32_t kernel_abi(void);

/* Return the fingerprint of the sources, as the build gave it. */
const char *kernel_fingerprint(void);

/* Make a scene. A piece that is not wanted or cannot be (without vertices, with numbers that are none, on a leg without a duration or
 * beyond a pole) leaves its pairs undecided. */
KernelStatus kernel_scene_make(const KernelPlane *plane, const KernelPieces *pieces, KernelScene **scene);

/* Free a scene, or nothing (NULL). */
void kernel_scene_free(KernelScene *scene);

/* Find all contacts of pairs, in the order of pairs and of time. A pair with a piece that cannot be is unresolved.
 * The work of a pair is bounded, its share of what two objects may take: beyond it, it is left as it is known by then, and
 * unresolved where distances took the most.
 *
 * contacts : made here, for kernel_contacts_free
 */
KernelStatus kernel_contacts(const KernelScene *scene, const KernelPairs *pairs, const KernelQuestion *question,
                             KernelContact **contacts, int64_t *count, KernelWork *work);

/* Free contacts, or nothing (NULL). */
void kernel_contacts_free(KernelContact *contacts);

/* Find where pairs meet at the instants low_s: where they overlap a point of both, else the middle between their nearest
 * points in the plane.
 *
 * degrees : (count, 2) longitude in [-180, 180) and latitude; NaN where a piece cannot be
 */
KernelStatus kernel_meetings(const KernelScene *scene, const KernelPairs *pairs, double *degrees);

/* Measure how far apart pairs are at the instants low_s: the length of the shortest way on the earth, minus the depth of
 * those that overlap.
 *
 * distance_m : (count,) never too large, too small by less than the plane's `distance_error_m`; NaN where a piece cannot be,
 *     and where the work is used up
 */
KernelStatus kernel_distances(const KernelScene *scene, const KernelPairs *pairs, double *distance_m);

/* Tell whether pairs, of which one is a part of an area, have places in common that are deep in the whole of it: at low_s, at
 * high_s and in the middle of them.
 *
 * area, is_b : (count,) the area; 0 where a is the part of it, else b is
 * east_m : (count,) how far east of the area the part is: copies of it lie whole turns away, plane metres
 * depth : (count,) KernelDepth. What is deeper than the margin by less than a thousandth of it may be shallow. Unknown where
 *     a piece cannot be, of an area without sides or with one of no numbers, where the margin is negative or no number, and
 *     where the work is used up
 */
KernelStatus kernel_whole_depths(const KernelScene *scene, const KernelPairs *pairs, const KernelAreas *areas,
                                 const int64_t *area, const int8_t *is_b, const double *east_m, int8_t *depth);

/* Tell what each piece of a scene is: (its count,) KernelState. */
KernelStatus kernel_states(const KernelScene *scene, int8_t *state);

/* Put the vertices of rows where they are at t (count,), to 1e-8 m on the earth.
 *
 * slots : at least as many as any of these pieces has vertices; xy : (2, slots, count) plane metres from the rows'
 *     origins. Pieces of fewer vertices repeat their last one; those that cannot be are no numbers.
 */
KernelStatus kernel_positions(const KernelScene *scene, const KernelRows *rows, const double *t, int64_t slots, double *xy);

/* Find where the reference points of rows are at t (count,): xy (2, count), plane metres from their origins. They run
 * straight. Of areas, and of pieces that cannot be, no numbers. */
KernelStatus kernel_references(const KernelScene *scene, const KernelRows *rows, const double *t, double *xy);

/* Bound how rows move during [t0, t1], (count,) both, within their slices. */
KernelStatus kernel_bounds(const KernelScene *scene, const KernelRows *rows, const double *t0, const double *t1,
                           const KernelBounds *bounds);

/* Make the convex hulls that hold pieces [first, end) during all of their time, and what comes within half of reach_m of
 * them: the hulls of two pieces meet wherever the pieces come within reach_m of each other.
 *
 * That of a haven is of its places at the start and the end of its slice, and as much larger as vertices may leave it
 * between; it is grown by squares of half of what reach_m takes up in the plane at the largest scale that the piece
 * reaches. Where two grown edges meet within 2.5 times that, along either axis, their corner takes the squares' place.
 *
 * hull : (HULL_PER_VERTEX v + HULL_MORE (end - first), 2) plane metres, v the vertices of these pieces: rings one after
 *     the other, counter-clockwise, each with its first vertex again at its end
 * hull_offset : (end - first + 1,) ring i: [offset[i], offset[i + 1]); empty where the piece cannot be
 * deviation : (end - first,) how far a vertex may leave the hull of its slice's ends, plane metres
 * reach : (end - first,) how far a vertex is from the reference point at the ends of the slice, plane metres; 0 of areas
 */
KernelStatus kernel_hulls(const KernelPlane *plane, const KernelPieces *pieces, int64_t first, int64_t end, double reach_m,
                          double *hull, int64_t *hull_offset, double *deviation, double *reach);

/* Join triangles of polygons to convex parts, over sides that are the same.
 *
 * triangle : (count, 3, 2) corners, counter-clockwise; of : (count,) polygon of each, those of one together
 * corner : (3 count,) room for the corners of parts, one part after the other: rows of all corners (3 count, 2)
 * offset : (count + 1,) room for where the corners of each part begin, and the last end; parts : (1,) how many there are
 */
KernelStatus kernel_convex_parts(const double *triangle, const int64_t *of, int64_t count, int64_t *corner, int64_t *offset,
                                 int64_t *parts);

/* Tell which hulls of pairs are apart: proven, whatever the rings are. Of convex ones that turn counter-clockwise those that
 * are not told meet, but for rounding.
 *
 * hull, hull_offset : (vertex_count, 2), (hull_count + 1,)  closed rings as kernel_hulls makes them, plane metres; an empty
 *     one is never apart
 * a, b : (count,) their hulls; apart : (count,) 1 or 0
 */
KernelStatus kernel_apart(const double *hull, int64_t vertex_count, const int64_t *hull_offset, int64_t hull_count,
                          const int64_t *a, const int64_t *b, int64_t count, uint8_t *apart);

/* Tell which pieces of one object are stored and looked up as one: a bundle takes up little more than its pieces do.
 *
 * boxes : (count, 4) least x, least y, largest x, largest y of hulls, plane metres
 * run : (count,) pieces next to each other that have the same number may go together
 * moves : (count,) 0 parts of areas, 1 slices of tracks, which come in the order of time and stay in it
 * order : (count,) room for the pieces, those of a bundle next to each other, in the order in which they came
 * begins : (count,) room: 1 where a bundle begins in that order, else 0
 */
KernelStatus kernel_bundles(const double *boxes, const int64_t *run, const uint8_t *moves, int64_t count, int64_t *order,
                            uint8_t *begins);

/* Read the rings of polygons and multipolygons without holes from WKB.
 *
 * wkb, offset : (size,), (count + 1,) little-endian bytes of all, and where those of each begin, and the last end
 * xy : (vertex_room, 2) room for the vertices of all rings; size / 16 of them are room enough
 * ring_offset : (rings + 1,) room for where the vertices of each ring begin, and the last end
 * rings : how many rings there are; another number, and other shapes, are KERNEL_BAD_COUNT
 */
KernelStatus kernel_wkb_rings(const uint8_t *wkb, int64_t size, const int64_t *offset, int64_t count, double *xy,
                              int64_t vertex_room, int64_t *ring_offset, int64_t rings);

/* Pieces in bundles, each in the order of time; areas are there for the same time. */
typedef struct {
    int64_t count, bundles;
    const int64_t *offset;        /* (bundles + 1,) where the pieces of each begin, and the last end */
    const double *boxes;          /* (count, 4) as above */
    const int64_t *start_us;      /* (count,) */
    const int64_t *end_us;        /* (count,) */
    const uint8_t *end_inclusive; /* (count,) whether that instant belongs to the piece */
} KernelBundled;

/* Find the pieces of pairs of bundles whose boxes meet and whose spans share an instant.
 *
 * a, b : (count,) bundles
 * first, second : (room,) pieces of a and of b, in the order of these pairs; as many as the pairs of their pieces is room
 *     enough
 * found : (1,) how many there are
 */
KernelStatus kernel_bundled_pairs(const KernelBundled *pieces, const int64_t *a, const int64_t *b, int64_t count,
                                  int64_t *first, int64_t *second, int64_t room, int64_t *found);

/* Rows of pieces, of each the box of what it holds. */
typedef struct {
    int64_t count;
    const double *boxes;     /* (count, 4) as above */
    const double *floor_m;   /* (count,) heights, which two rows share inside of both */
    const double *ceiling_m; /* (count,) */
    const int64_t *start_us; /* (count,) */
    const int64_t *end_us;   /* (count,) */
    const int64_t *object;   /* (count,) a number for the object that it is of */
    const uint8_t *is_copy;  /* (count,) 1 for those of a seam copy, two of which meet elsewhere, too */
} KernelBoxes;

/* Order rows so that those that are near each other, in place and in time, follow each other.
 *
 * order : (count,) room for the rows
 */
KernelStatus kernel_box_order(const KernelBoxes *rows, int64_t *order);

/* Find the rows that meet some others in place, height and time, of objects of a larger number.
 *
 * rows : in the order that kernel_box_order gives; in another one it takes longer
 * of : (wanted,) rows, those of an object next to each other
 * first, second : (room,) which meet; those of each row of `of` follow each other, in the order of these
 * done : (1,) of how many of these they are: of objects whose pairs have room; the others are left aside
 * found : (1,) how many there are
 * looked_at : (1,) boxes that were compared for them, of rows and of rows together
 */
KernelStatus kernel_box_pairs(const KernelBoxes *rows, const int64_t *of, int64_t wanted, int64_t *first, int64_t *second,
                              int64_t room, int64_t *done, int64_t *found, int64_t *looked_at);

/* Find how close pairs come, the closest of each group: both ends of their time count.
 *
 * pair : (groups,) the pair that comes closest; -1 where none is within wanted_m, and where the number is not known
 * at_s : (groups,) seconds of that pair: the earliest instant that is within 1e-7 m of the least; of a touch the first;
 *     where aim_m is more than 2.5e-4 some instant at which it is distance_m, to a hundredth of aim_m
 * distance_m : (groups,) metres on the earth, 0 where they touch, infinite beyond wanted_m; NaN where a piece cannot be,
 *     and where the work of distances is used up
 * error_m : (groups,) how far from it the least distance may be, either way
 * a_deg, b_deg : (groups, 2) longitude in [-180, 180) and latitude of the nearest points of a and of b
 */
KernelStatus kernel_approaches(const KernelScene *scene, const KernelPairs *pairs, const KernelGroups *groups,
                               int64_t *pair, double *at_s, double *distance_m, double *error_m, double *a_deg,
                               double *b_deg, KernelWork *work);

/* Find where pairs come within reach_m of each other during [low_s, high_s], or might: what both sweep meanwhile, grown by
 * half of reach_m each, and that in common. Of two that stand still and overlap it is what they have in common; that
 * which is no wider than a micrometre is nothing.
 *
 * ring : (REGION_PER_VERTEX v + REGION_MORE count, 2) v the vertices of all pieces of the pairs: plane metres, within half a
 *     turn of a Mercator plane, counter-clockwise, each ring with its first vertex again at its end
 * ring_offset : (2 count + 1,) rings 2 i and 2 i + 1 of pair i, the second where it lies across the seam. Both are empty
 *     where they do not come so near.
 * what : (count,) KernelRegion
 */
KernelStatus kernel_regions(const KernelScene *scene, const KernelPairs *pairs, double reach_m, double *ring,
                            int64_t *ring_offset, int8_t *what);

/* Put convex rings of one owner that follow each other together, while the hull of some is larger than their union by no
 * more than a tenth. Room for as many rings and vertices as there are is enough.
 *
 * ring, ring_offset, owner : (vertex_count, 2), (count + 1,), (count,) closed, counter-clockwise; of fewer than three corners: none
 * joined_ring, joined_offset, joined_owner : (w, 2), (joined_count + 1,), (joined_count,) closed, counter-clockwise
 */
KernelStatus kernel_joined(const double *ring, int64_t vertex_count, const int64_t *ring_offset, const int64_t *owner,
                           int64_t count, double *joined_ring, int64_t *joined_offset, int64_t *joined_owner,
                           int64_t *joined_count);

/* A part of rows of bytes, of one width, or ragged where there are offsets. */
typedef struct {
    const uint8_t *data;
    int64_t size;          /* bytes of data */
    const int64_t *offset; /* (count + 1,) where the part of each row begins in data, and the last ends; or NULL */
    int64_t width;         /* bytes of the part of each row, where offset is NULL */
} KernelPart;

/* Write rows of bytes one after the other: of each row its parts, in their order. rows: (size,), which they fill. */
KernelStatus kernel_interleave(const KernelPart *parts, int64_t part_count, int64_t count, uint8_t *rows, int64_t size);

/* Digest rows of bytes, of each its parts in their order, by SipHash-2-4. key: (2,) words; digest: (count,) */
KernelStatus kernel_digests(const KernelPart *parts, int64_t part_count, int64_t count, const uint64_t *key,
                            uint64_t *digest);

#endif
