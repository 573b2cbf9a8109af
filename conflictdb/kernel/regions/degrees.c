/* Outlines in longitude and latitude of rings of the plane: each contains its ring, and reaches little beyond it.
 *
 * A straight side of the plane is a curve in longitude and latitude, which bends towards the nearer pole. It is cut into
 * parts whose chords leave the curve by at most the limit. Where the curve bends outward, corners move outward by as much
 * as it leaves the chord; elsewhere the chord itself lies outside. So a part is contained if both of its ends lie outside
 * of its chord by at least what it needs. A corner takes the shortest step that satisfies both of its parts. If that is
 * longer than the limit, as at an acute corner, the corner is cut and takes two steps. A corner that saves a part if it is
 * left out is left out: the new side needs the distance of the corner as well.
 *
 * Bend of a part, with phi its latitude, t the tangent of the conformal latitude and L its length in radians:
 * Mercator: phi is a function of psi with |phi''| <= (1 + 6 e^2) t / (1 + t^2), e the eccentricity (< 0.1); so it leaves
 *     the chord by at most |phi''| dpsi^2 / 8 in latitude.
 * Great circles: with a the bearing and s = sin a, the circle leaves the straight line in longitude and latitude at the
 *     rate tan(phi) s (2 - s^2) per radian. Along the part a changes by at most w = L tan(phi), and scales of longitude by
 *     the share w: at most L^2 / 8 tan(phi) (1 + w) (s (2 - s^2) + 4 w) across the chord.
 *
 * If outlines change, raise EDITION of core/conflict_regions.py: databases then rewrite them.
 */
#include <stdlib.h>

#include "regions/rings.h"

/* Every corner moves outward by this, metres: more than rounding in the plane (5e-8 m) and in degrees (2e-9 m). */
static const double OUTWARD_M = 1e-5;
/* At most about this many parts of a ring. A track around the earth had 12 million corners, more than PostgreSQL can print.
 * With fewer, long sides reach further beyond the ring. */
static const int64_t MOST_PARTS = 20000;
/* No radius of curvature of an earth is larger than the equator's by more than this, and no distance in the plane is
 * shorter by more in longitude and latitude. */
static const double LARGEST_RADIUS = 1.004, LARGEST_STRETCH = 1.014;
/* Share of the limit that estimates use, and that corners which are left out may; share of that in the next try, and that
 * parts have at least. */
static const double USED_SHARE = 0.998, LEFT_SHARE = 0.5, LESS_SHARE = 0.8, LEAST_SHARE = 0.1;
/* Largest change of bearing along a part of a great circle, radians. */
static const double MOST_TURN = 0.1;
/* How much more than the mean a part of a great circle bends, about. */
static const double MOST_UNEQUAL = 1.25;
/* Next to a pole, degrees, no outline is known in a gnomonic plane; nor if longitudes jump, as they do across a pole. */
static const double HIGHEST_DEG = 89.5, LARGEST_STEP_DEG = 90.0;
/* Corners on the antimeridian stay there; its sides face this direction at least, as a sine, or the outline lies beyond. */
static const double LEAST_SINE = 0.05;
/* A cut lies this share of its steps ahead of its corner, and of those that were left out beside it. */
static const double CUT_AHEAD = 0.02;
static const double DEGREES = 0x1.ca5dc1a63c1f8p5; /* 180 / pi */

enum { LATITUDE_TERMS = 6, MOST_TRIES = 8 };

/* A place on the ring: degrees, the tangent of its conformal latitude, and the cosine. */
typedef struct {
    double lon, lat, tangent, cosine;
} Spot;

/* What contains the corners beside a side that were left out: lengths along the side from its start, and to the right of
 * it, in the plane; empty if low > high. */
typedef struct {
    double low, high, left, right;
} Around;

/* A corner of the ring, and the side that leads to the next corner. */
typedef struct {
    Spot spot;
    double x, y;         /* in the plane */
    double bend_m;       /* how far the whole side leaves its chord, metres */
    double limit_m;      /* how far a part may */
    double out_m, in_m;  /* how far outside and inside of it the corners are that were left out */
    int64_t parts, next; /* next: number of the next corner that is left */
    Vector along;        /* unit vector in the plane */
    double length;       /* in the plane */
    bool is_outward;     /* whether it bends outward */
    Around around;
} Side;

/* The start of a part, and how far it leaves its chord: in latitude and across it, scaled degrees. */
typedef struct {
    Spot spot;
    double north, across;
    double out, in;  /* how far outside and inside of it places are that it must contain beside the bend, scaled degrees */
    bool is_outward; /* whether it bends outward */
} Part;

struct Tracing {
    const KernelPlane *plane;
    double latitude[LATITUDE_TERMS], bend, sine, cosine; /* coefficients of latitudes; of the centre of a gnomonic plane */
    double limit_m, used_m;                              /* used_m: as much of the limit as estimates may use */
    Side *sides;
    Part *parts;
    int64_t side_room, part_room, count; /* count: of parts */
};

/* Coefficients c_j of phi(chi) = chi + sum of c_j sin(2 j chi), in the third flattening (Karney 2011). Rounding remains
 * for flattenings of up to a hundredth. */
static void latitude_terms(const KernelPlane *plane, double c[LATITUDE_TERMS]) {
    double root = sqrt(1.0 - plane->eccentricity * plane->eccentricity), n = (1.0 - root) / (1.0 + root);
    double n2 = n * n, n3 = n2 * n, n4 = n3 * n, n5 = n4 * n, n6 = n5 * n;
    c[0] = 2.0 * n - 2.0 * n2 / 3.0 - 2.0 * n3 + 116.0 * n4 / 45.0 + 26.0 * n5 / 45.0 - 2854.0 * n6 / 675.0;
    c[1] = 7.0 * n2 / 3.0 - 8.0 * n3 / 5.0 - 227.0 * n4 / 45.0 + 2704.0 * n5 / 315.0 + 2323.0 * n6 / 945.0;
    c[2] = 56.0 * n3 / 15.0 - 136.0 * n4 / 35.0 - 1262.0 * n5 / 105.0 + 73814.0 * n6 / 2835.0;
    c[3] = 4279.0 * n4 / 630.0 - 332.0 * n5 / 35.0 - 399572.0 * n6 / 14175.0;
    c[4] = 4174.0 * n5 / 315.0 - 144838.0 * n6 / 6237.0;
    c[5] = 601676.0 * n6 / 22275.0;
}

Tracing *tracing_make(const KernelPlane *plane, double limit_m) {
    Tracing *tracing = calloc(1, sizeof *tracing);
    if (!tracing) return NULL;
    tracing->plane = plane, tracing->limit_m = limit_m;
    latitude_terms(plane, tracing->latitude);
    tracing->bend = 1.0 + 6.0 * plane->eccentricity * plane->eccentricity;
    earth_direction(plane->centre_lat_deg, &tracing->sine, &tracing->cosine);
    return tracing;
}

void tracing_free(Tracing *tracing) {
    if (!tracing) return;
    free(tracing->sides), free(tracing->parts);
    free(tracing);
}

static Spot mercator_spot(const Tracing *tracing, double x, double y) {
    double t = sinh(y / tracing->plane->radius_m), square = 1.0 + t * t, ahead = 0.0, now = 0.0;
    double sine = 2.0 * t / square, cosine = 2.0 * (1.0 - t * t) / square;
    for (int k = LATITUDE_TERMS - 1; k >= 0; k--) {
        double next = tracing->latitude[k] + cosine * now - ahead;
        ahead = now, now = next;
    }
    double lon = x / tracing->plane->radius_m * DEGREES, lat = (atan(t) + sine * now) * DEGREES;
    return (Spot){fabs(fabs(lon) - 180.0) < 1e-11 ? copysign(180.0, lon) : lon, lat, t, 1.0 / sqrt(square)};
}

/* Longitudes are within half a turn of the centre's. */
static Spot gnomonic_spot(const Tracing *tracing, double x, double y) {
    double east = x / tracing->plane->radius_m, north = y / tracing->plane->radius_m;
    double out = tracing->cosine - north * tracing->sine, axis = tracing->sine + north * tracing->cosine;
    double level = sqrt(east * east + out * out), length = sqrt(level * level + axis * axis);
    return (Spot){tracing->plane->centre_lon_deg + atan2(east, out) * DEGREES, atan2(axis, level) * DEGREES, axis / level,
                  level / length};
}

static bool is_mercator(const Tracing *tracing) { return tracing->plane->projection == KERNEL_MERCATOR; }

static Spot spot_at(const Tracing *tracing, double x, double y) {
    return is_mercator(tracing) ? mercator_spot(tracing, x, y) : gnomonic_spot(tracing, x, y);
}

static bool is_known(const Tracing *tracing, const Spot *spot) {
    if (!isfinite(spot->lon) || !isfinite(spot->lat) || !(spot->cosine > 0.0)) return false;
    return is_mercator(tracing) || fabs(spot->lat) <= HIGHEST_DEG;
}

/* The largest cosine between two spots. */
static double widest(const Spot *one, const Spot *other) {
    return one->tangent * other->tangent < 0.0 ? 1.0 : fmax(one->cosine, other->cosine);
}

/* The largest t / (1 + t^2) between two spots. */
static double largest_bend(const Spot *one, const Spot *other) {
    double high = fmax(fabs(one->tangent), fabs(other->tangent));
    double low = one->tangent * other->tangent < 0.0 ? 0.0 : fmin(fabs(one->tangent), fabs(other->tangent));
    if (low <= 1.0 && high >= 1.0) return 0.5;
    return fmax(low / (1.0 + low * low), high / (1.0 + high * high));
}

/* Whether the curve from one spot to another leaves its chord to the right of it, or may. */
static bool bends_outward(const Spot *from, const Spot *to) {
    if (from->tangent * to->tangent < 0.0) return true;
    return from->tangent + to->tangent > 0.0 ? to->lon < from->lon : to->lon > from->lon;
}

/* The bend across the chord of a part of a great circle, radians; how much of it may be on the other side; the change of
 * bearing. */
typedef struct {
    double bend, doubt, turn;
} CircleBend;

static CircleBend circle_bend(const Spot *from, const Spot *to) {
    double east = (to->lon - from->lon) / DEGREES, north = (to->lat - from->lat) / DEGREES;
    double length = hypot(east * widest(from, to), north), half = tan(fmin(0.5 * length, 1.5));
    double t = fmax(fabs(from->tangent), fabs(to->tangent)), across = fabs(east) * from->cosine;
    t = t * half < 0.5 ? (t + half) / (1.0 - t * half) : INFINITY;
    double wide = length > 0.0 ? across / hypot(across, north) : 0.0;
    double turn = length * t, factor = 0.125 * length * length * t * (1.0 + turn), doubt = 4.0 * factor * turn;
    return (CircleBend){factor * wide * (2.0 - wide * wide) + doubt, doubt, turn};
}

/* Estimate the bend of a whole side. */
static void measure_side(const Tracing *tracing, Side *side, const Side *to) {
    double radius_m = tracing->plane->radius_m, x = to->x - side->x, y = to->y - side->y, length = sqrt(x * x + y * y);
    const Spot *from = &side->spot, *end = &to->spot;
    side->along = length > 0.0 ? (Vector){x / length, y / length} : (Vector){0.0, 0.0}, side->length = length;
    side->is_outward = bends_outward(from, end);
    if (is_mercator(tracing)) {
        double rise = y / radius_m, bend = 0.125 * tracing->bend * largest_bend(from, end) * rise * rise;
        side->bend_m = bend * fabs(side->along.x) * LARGEST_RADIUS * radius_m;
        /* Of parts across the equator both halves of the bend count. */
        if (from->tangent * end->tangent < 0.0) side->bend_m *= 2.0;
        return;
    }
    double east = (end->lon - from->lon) / DEGREES, north = (end->lat - from->lat) / DEGREES;
    double across = fabs(east) * from->cosine, square = north * north + across * across;
    Spot middle = gnomonic_spot(tracing, 0.5 * (side->x + to->x), 0.5 * (side->y + to->y));
    double t = fmax(fabs(middle.tangent), fmax(fabs(from->tangent), fabs(end->tangent)));
    double wide = square > 0.0 ? across / sqrt(square) : 0.0;
    side->bend_m = 0.125 * square * t * wide * (2.0 - wide * wide) * radius_m;
    if (from->tangent * end->tangent < 0.0) side->bend_m *= 2.0;
}

/* Fewest parts with a bend of at most limit_m each. */
static int64_t parts_for(double bend_m, double limit_m) {
    double parts = ceil(sqrt(bend_m / limit_m));
    return parts >= 1.0 ? parts < (double)MOST_PARTS ? (int64_t)parts : MOST_PARTS : 1;
}

/* Extend what a side is surrounded by, for a place in the plane. */
static void add_place(Side *side, double x, double y) {
    double from_x = x - side->x, from_y = y - side->y;
    double along = from_x * side->along.x + from_y * side->along.y, right = from_x * side->along.y - from_y * side->along.x;
    Around *around = &side->around;
    around->low = fmin(around->low, along), around->high = fmax(around->high, along);
    around->left = fmin(around->left, right), around->right = fmax(around->right, right);
}

/* The same for all that surrounds another side. */
static void add_around(Side *side, const Side *other) {
    const Around *around = &other->around;
    for (int k = 0; k < 4 && around->low <= around->high; k++) {
        double along = k & 1 ? around->high : around->low, right = k & 2 ? around->right : around->left;
        add_place(side, other->x + along * other->along.x + right * other->along.y,
                  other->y + along * other->along.y - right * other->along.x);
    }
}

/* The tangent of the largest angle by which directions differ between the plane and scaled degrees, along a side. */
static double skew(const Tracing *tracing, const Side *from, const Side *to) {
    if (is_mercator(tracing)) return 0.01;
    double square = fmax(from->x * from->x + from->y * from->y, to->x * to->x + to->y * to->y);
    double scale = 1.0 + square / (tracing->plane->radius_m * tracing->plane->radius_m);
    return 0.01 + 0.55 * (scale - 1.0) / sqrt(scale);
}

/* Whether a side may take the place of two, and then has fewer parts. wide: the side, on return. */
static bool saves_part(const Tracing *tracing, const Side *first, const Side *corner, const Side *after, Side *wide) {
    double limit_m = tracing->used_m, scale = 1.0;
    *wide = *first, wide->next = corner->next, wide->around = (Around){INFINITY, -INFINITY, 0.0, 0.0};
    measure_side(tracing, wide, after);
    add_place(wide, corner->x, corner->y);
    /* Most corners are far away. */
    if (!(wide->around.right - wide->around.left < limit_m / (LARGEST_RADIUS * corner->spot.cosine))) return false;
    add_around(wide, first), add_around(wide, corner);
    /* They lie beside the side, also in degrees, where angles differ. */
    double margin = skew(tracing, first, after) * fmax(wide->around.right, -wide->around.left);
    if (!(wide->around.low >= margin && wide->around.high <= wide->length - margin)) return false;
    if (fabs(corner->spot.lon) == 180.0) return false;
    if (is_mercator(tracing)) scale = LARGEST_RADIUS * widest(&first->spot, &after->spot);
    wide->out_m = scale * wide->around.right, wide->in_m = -scale * wide->around.left;
    double rest_m = limit_m - wide->out_m - wide->in_m;
    if (!(rest_m >= (1.0 - LEFT_SHARE) * limit_m)) return false;
    wide->parts = parts_for(wide->bend_m, rest_m);
    return wide->parts < first->parts + corner->parts;
}

/* Leave out corners that save a part; returns the first corner that is left. At least three are. */
static int64_t leave_out(Tracing *tracing, int64_t count) {
    int64_t before = 0, left = count;
    for (int64_t tried = 0; tried < count && left > 3; tried++) {
        Side *first = tracing->sides + before, *corner = tracing->sides + first->next, wide;
        if (saves_part(tracing, first, corner, tracing->sides + corner->next, &wide)) *first = wide, left--;
        else before = first->next;
    }
    return before;
}

/* How far the chord of a side starts outside of it, because the side beside it needs that. */
static double start_m(const Tracing *tracing, const Side *side, const Side *beside) {
    double bend_m = beside->is_outward ? beside->bend_m / ((double)beside->parts * (double)beside->parts) : 0.0;
    /* Parts of great circles bend differently, and angles between them are not those in the plane. */
    if (!is_mercator(tracing)) return MOST_UNEQUAL * bend_m + beside->out_m;
    double turn = side->along.x * beside->along.x + side->along.y * beside->along.y;
    return fmax(turn, 0.0) * (bend_m + beside->out_m);
}

/* How far a chord reaches that starts and ends outside of a curve, which bends inward. */
static double reach(double one, double other, double bend) {
    if (bend <= 0.25 * fabs(other - one)) return fmax(one, other);
    return bend + 0.5 * (one + other) + (other - one) * (other - one) / (16.0 * bend);
}

/* Choose the number of parts of each side from the first on, so that no part reaches further than the limit; returns the
 * sum. */
static int64_t choose_parts(Tracing *tracing, int64_t first, int64_t last) {
    int64_t total = 0, before = last, at = first;
    do {
        Side *side = tracing->sides + at;
        side->limit_m = fmax(tracing->used_m - side->out_m - side->in_m, LEAST_SHARE * tracing->used_m);
        side->parts = parts_for(side->bend_m, side->limit_m), at = side->next;
    } while (at != first);
    do {
        Side *side = tracing->sides + at;
        if (!side->is_outward) {
            double start = fmax(start_m(tracing, side, tracing->sides + before), side->out_m);
            double end = fmax(start_m(tracing, side, tracing->sides + side->next), side->out_m);
            double square = (double)side->parts * (double)side->parts,
                   rest_m = fmax(tracing->used_m - side->in_m, side->limit_m);
            double most = fmin(fmax(start, end), rest_m);
            side->limit_m = fmin(side->limit_m, 0.5 * (rest_m - 0.5 * most + sqrt(rest_m * (rest_m - most))));
            if (reach(start, end, side->bend_m / square) > rest_m) {
                int64_t parts = parts_for(side->bend_m, side->limit_m);
                side->parts = parts > side->parts ? parts : side->parts + 1;
            }
        }
        total += side->parts, before = at, at = side->next;
    } while (at != first);
    if (total <= MOST_PARTS) return total;
    double share = (double)MOST_PARTS / (double)total;
    total = 0;
    do {
        Side *side = tracing->sides + at;
        side->parts = (int64_t)ceil((double)side->parts * share), side->limit_m = INFINITY;
        total += side->parts, at = side->next;
    } while (at != first);
    return total;
}

static bool make_parts(Tracing *tracing, int64_t more, bool *has_memory) {
    int64_t room = 2 * (tracing->count + more);
    if (tracing->count + more <= tracing->part_room) return true;
    Part *parts = realloc(tracing->parts, (size_t)room * sizeof *parts);
    *has_memory = parts != NULL;
    if (parts) tracing->parts = parts, tracing->part_room = room;
    return parts != NULL;
}

/* Append the parts of a side; returns the number of parts that it should have, 0 if it is unknown. */
static int64_t add_parts(Tracing *tracing, const Side *side, const Side *end) {
    double parts = (double)side->parts, radius_m = tracing->plane->radius_m, rise = (end->y - side->y) / radius_m / parts;
    double worst_m = 0.0, turn = 0.0, in = side->in_m / radius_m * DEGREES;
    Spot here = side->spot;
    for (int64_t k = 1; k <= side->parts; k++) {
        double share = (double)k / parts, stretch = LARGEST_STRETCH * widest(&here, &end->spot) / radius_m;
        Spot there = end->spot;
        if (k < side->parts)
            there = spot_at(tracing, side->x + share * (end->x - side->x), side->y + share * (end->y - side->y));
        if (!is_known(tracing, &there)) return 0;
        Part part = {.spot = here, .in = in, .is_outward = bends_outward(&here, &there)};
        part.out = stretch * side->out_m / fmin(here.cosine, there.cosine) * DEGREES;
        if (is_mercator(tracing)) {
            part.north = 0.125 * tracing->bend * largest_bend(&here, &there) * rise * rise * DEGREES;
        } else {
            CircleBend found = circle_bend(&here, &there);
            part.across = found.bend * DEGREES;
            if (!part.is_outward) part.out += fmax(2.0 * found.doubt - found.bend, 0.0) * DEGREES;
            worst_m = fmax(worst_m, found.bend * radius_m), turn = fmax(turn, found.turn);
        }
        if (here.lon != there.lon || here.lat != there.lat) tracing->parts[tracing->count++] = part;
        here = there;
    }
    double few = fmax(sqrt(worst_m / side->limit_m), turn / MOST_TURN);
    if (!(few > 1.0)) return side->parts;
    return parts_for(1.02 * few * few * parts * parts, 1.0);
}

/* Append the parts of a side, as many as it needs; false if it is unknown. */
static bool add_side(Tracing *tracing, Side *side, const Side *end, bool *has_memory) {
    int64_t first = tracing->count;
    for (int tries = 0; tries < MOST_TRIES; tries++) {
        tracing->count = first;
        if (!make_parts(tracing, side->parts, has_memory)) return false;
        int64_t parts = add_parts(tracing, side, end);
        if (parts <= side->parts) return parts > 0;
        side->parts = parts < 16 * side->parts ? parts : 16 * side->parts;
    }
    return true;
}

/* A part as seen from one of its ends: its outward normal in degrees that are scaled there, how far it bends, and how far
 * outside the end must lie. */
typedef struct {
    Vector normal;
    double bend, need;
} View;

static View view(const Part *part, const Spot *to, double cosine, double outward) {
    double east = (to->lon - part->spot.lon) * cosine, north = to->lat - part->spot.lat;
    double length = sqrt(east * east + north * north), bend = part->north * fabs(east) / length + part->across;
    return (View){{north / length, -east / length}, bend, part->out + (part->is_outward ? bend : 0.0) + outward};
}

static double outside(const View *part, Vector step) { return part->normal.x * step.x + part->normal.y * step.y; }

/* How far a part reaches beyond what it must contain, if its ends lie outside of it as given. */
static double reach_of(const Part *part, double bend, double start, double end) {
    return part->in + reach(start, end, part->is_outward ? 0.0 : bend);
}

/* The step of a corner on the antimeridian along it, as one of its sides is. */
static Vector seam_step(const View *part) {
    if (fabs(part->normal.y) < LEAST_SINE) return (Vector){part->normal.x, 0.0};
    return (Vector){0.0, part->need / part->normal.y};
}

/* Append the corners of all parts, moved outward; returns how far the outline reaches beyond its ring, scaled degrees. */
static double move_corners(const Tracing *tracing, double limit, Rings *found) {
    const Part *parts = tracing->parts;
    double outward = OUTWARD_M / (LARGEST_RADIUS * tracing->plane->radius_m) * DEGREES, most = 0.0;
    double start = 0.0, end = 0.0, bend = 0.0;
    for (int64_t i = 0, count = tracing->count; i < count; i++) {
        const Part *before = parts + (i > 0 ? i - 1 : count - 1), *part = parts + i;
        const Spot *spot = &part->spot, *next = &parts[i + 1 < count ? i + 1 : 0].spot;
        View one = view(before, spot, spot->cosine, outward), other = view(part, next, spot->cosine, outward);
        Vector step = step_for(one.normal, one.need, other.normal, other.need), last = step;
        bool arrives = fabs(spot->lon) == 180.0 && before->spot.lon == spot->lon;
        bool leaves = fabs(spot->lon) == 180.0 && next->lon == spot->lon;
        double turn = one.normal.x * other.normal.x + one.normal.y * other.normal.y;
        if (arrives && leaves) step = last = (Vector){0.0, 0.0};
        else if (arrives) step = last = seam_step(&other);
        else if (leaves) step = last = seam_step(&one);
        else if (!(hypot(step.x, step.y) <= limit - fmax(before->in, part->in)) && turn < 0.99) {
            /* Both ends of the cut lie ahead of the corner, on the lines of their parts, which may have changed sides. */
            double crossed = one.normal.y * other.normal.x - one.normal.x * other.normal.y;
            double ahead = outward + (CUT_AHEAD + fmax(crossed, 0.0)) * fmax(one.need, other.need);
            last = (Vector){one.need * one.normal.x - ahead * one.normal.y, one.need * one.normal.y + ahead * one.normal.x};
            step = (Vector){other.need * other.normal.x + ahead * other.normal.y,
                            other.need * other.normal.y - ahead * other.normal.x};
            rings_add(found, spot->lon + last.x / spot->cosine, spot->lat + last.y);
        }
        rings_add(found, spot->lon + step.x / spot->cosine, spot->lat + step.y);
        if (i > 0) most = fmax(most, reach_of(before, one.bend, start, outside(&one, last)));
        else bend = one.bend, end = outside(&one, last);
        start = outside(&other, step);
        most = fmax(most, fmax(hypot(step.x, step.y), hypot(last.x, last.y)));
    }
    return fmax(most, reach_of(parts + tracing->count - 1, bend, start, end));
}

/* Read the corners of a ring, and measure its sides; false if it is unknown. */
static bool read_ring(Tracing *tracing, const double (*vertex)[2], int64_t count, bool *has_memory) {
    if (count > tracing->side_room) {
        Side *sides = realloc(tracing->sides, 2 * (size_t)count * sizeof *sides);
        *has_memory = sides != NULL;
        if (!sides) return false;
        tracing->sides = sides, tracing->side_room = 2 * count;
    }
    for (int64_t i = 0; i < count; i++) {
        Side *side = tracing->sides + i;
        *side = (Side){.spot = spot_at(tracing, vertex[i][0], vertex[i][1]), .x = vertex[i][0], .y = vertex[i][1]};
        side->next = i + 1 < count ? i + 1 : 0, side->around = (Around){INFINITY, -INFINITY, 0.0, 0.0};
        if (!is_known(tracing, &side->spot)) return false;
    }
    for (int64_t i = 0; i < count; i++) {
        Side *side = tracing->sides + i;
        measure_side(tracing, side, tracing->sides + side->next);
        side->parts = parts_for(side->bend_m, tracing->used_m);
    }
    return true;
}

/* Cut the sides from the first on into parts; false if the outline is unknown. */
static bool cut_sides(Tracing *tracing, int64_t first, bool *has_memory) {
    int64_t last = first, at = first;
    while (tracing->sides[last].next != first) last = tracing->sides[last].next;
    tracing->count = 0;
    if (!make_parts(tracing, choose_parts(tracing, first, last), has_memory)) return false;
    do {
        Side *side = tracing->sides + at;
        if (!add_side(tracing, side, tracing->sides + side->next, has_memory)) return false;
        at = side->next;
    } while (at != first);
    for (int64_t i = 0; i < tracing->count && !is_mercator(tracing); i++) {
        const Spot *next = &tracing->parts[i + 1 < tracing->count ? i + 1 : 0].spot;
        if (fabs(next->lon - tracing->parts[i].spot.lon) > LARGEST_STEP_DEG) return false;
    }
    return tracing->count >= 3;
}

bool trace(Tracing *tracing, const double (*vertex)[2], int64_t count, bool is_hole, Rings *found, bool *has_memory) {
    *has_memory = true, tracing->used_m = USED_SHARE * tracing->limit_m;
    if (count < 3 || !read_ring(tracing, vertex, count, has_memory)) return false;
    int64_t first = leave_out(tracing, count), start = found->vertices;
    double to_degrees = DEGREES / (LARGEST_RADIUS * tracing->plane->radius_m);
    for (int tries = 0; tries < MOST_TRIES; tries++, tracing->used_m *= LESS_SHARE) {
        if (!cut_sides(tracing, first, has_memory)) return false;
        *has_memory = rings_make_room(found, 1, 2 * tracing->count);
        if (!*has_memory) return false;
        found->vertices = start;
        double most = move_corners(tracing, USED_SHARE * tracing->limit_m * to_degrees, found);
        /* Estimates of great circles may be too low; with too many parts there is no limit. */
        if (most <= tracing->limit_m * to_degrees || tracing->count >= MOST_PARTS) break;
    }
    rings_end(found, is_hole);
    return true;
}
