/* Where moving polygons are, sample by sample, by formulas of its own, and what of a solver's answers that contradicts.
 *
 * Shares nothing with the kernel: rhumb lines by latitudes and their isometric latitudes as textbooks have them, on the
 * ellipsoid by Helmert's series for the meridian; great circles by interpolation between vectors; overlap by separating
 * axes. Coarse on purpose: good to a tenth of a millimetre, and blind to what happens between samples.
 *
 * J. P. Snyder, "Map Projections: A Working Manual", USGS Professional Paper 1395 (1987), sections 3, 7 and 22.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

/* Samples contradict an answer by more than this, metres on the earth. */
static const double TOLERANCE_M = 1e-3;
/* So many samples a pair that is near, and steps of the search for the instant at which it is nearest. */
enum { SAMPLES = 64, STEPS = 16, MOST_VERTICES = 128 };
/* Just outside of the ends of a contact, seconds. */
static const double ASIDE_S = 1e-3;

typedef struct {
    int32_t is_gnomonic;
    double radius_m, flattening, centre_lon_deg, centre_lat_deg;
} Earth;

typedef struct {
    const int8_t *moves;
    const int16_t *turn;
    const int64_t *leg_start_us, *leg_end_us;
    const double *leg_start_deg, *leg_end_deg, *bearing_deg;
    const int64_t *offset;
    const double *shape, *shape_to;
} Pieces;

/* What is claimed: contacts of pair i are [offset[i], offset[i + 1]). */
typedef struct {
    const int64_t *offset;
    const double *start_s, *end_s, *error_s;
    const int8_t *is_certain;
} Claims;

/* What was done, and the first contradictions: kinds 1 (overlap outside of all contacts), 2 (apart within a certain
 * contact), 3 (a certain contact without any overlap). */
typedef struct {
    int64_t samples, overlapping, wrong, pair[16], kind[16];
    double at_s[16], gap_m[16];
} Findings;

typedef struct {
    int count;
    double x[MOST_VERTICES], y[MOST_VERTICES];
} Shape;

/* A piece about to be sampled; what does not change with time. */
typedef struct {
    bool moves;
    int64_t first, count, leg_start_us;
    double leg_s, zero_s;
    double mu0, mu1, lon0, lon1, way, east, north;  /* rhumb lines */
    double from[3], along[3], across[3], angle;     /* great circles */
} Rider;

typedef struct {
    const Earth *earth;
    const Pieces *pieces;
    double n, e, rectifying_m; /* third flattening, eccentricity, metres per radian of rectifying latitude */
    double centre[3], to_east[3], to_north[3];
} World;

static const double DEGREE = 0.017453292519943295;

/* Rectifying latitude of a geographic one, and back (Helmert; Snyder 3-26). */
static double rectifying(const World *world, double lat) {
    double n = world->n, n2 = n * n, n3 = n2 * n, n4 = n2 * n2, n5 = n4 * n, whole = 1.0 + n2 / 4.0 + n4 / 64.0;
    double sum = -1.5 * (n - n3 / 8.0 - n5 / 64.0) * sin(2.0 * lat) + 15.0 / 16.0 * (n2 - n4 / 4.0) * sin(4.0 * lat);
    sum += -35.0 / 48.0 * (n3 - 5.0 / 16.0 * n5) * sin(6.0 * lat) + 315.0 / 512.0 * n4 * sin(8.0 * lat);
    return lat + sum / whole;
}

static double geographic(const World *world, double mu) {
    double n = world->n;
    if (n == 0.0) return mu;
    double n2 = n * n, n3 = n2 * n, n4 = n2 * n2, n5 = n4 * n, sine = sin(2.0 * mu), c = cos(2.0 * mu);
    /* sin 2 mu, sin 4 mu, ... as sin 2 mu times polynomials in its cosine. */
    double sum = 1.5 * n - 27.0 / 32.0 * n3 + 269.0 / 512.0 * n5 + (21.0 / 16.0 * n2 - 55.0 / 32.0 * n4) * 2.0 * c;
    sum += (151.0 / 96.0 * n3 - 417.0 / 128.0 * n5) * (4.0 * c * c - 1.0) + 1097.0 / 512.0 * n4 * (8.0 * c * c - 4.0) * c;
    return mu + sine * sum;
}

/* Isometric latitude, as plane coordinates over the equatorial radius: atanh(sin) - e atanh(e sin). */
static double isometric(const World *world, double mu) {
    double sine = sin(geographic(world, mu)), q = world->e * world->e, s2 = q * sine * sine;
    return 0.5 * log((1.0 + sine) / (1.0 - sine)) - q * sine * (1.0 + s2 * (1.0 / 3.0 + s2 * (0.2 + s2 * (1.0 / 7.0 + s2 / 9.0))));
}

/* How far east, in longitude, a way of 1 to the east leads while the latitude goes from mu1 to mu2. */
static double stretch(const World *world, double mu1, double psi1, double mu2, double psi2, double least) {
    if (fabs(mu2 - mu1) > least) return (psi2 - psi1) / (mu2 - mu1);
    /* The mean of d psi / d mu, by Gauss and Legendre's rule of three points. */
    double middle = 0.5 * (mu1 + mu2), half = 0.5 * (mu2 - mu1) * 0.7745966692414834, sum = 0.0;
    for (int k = -1; k <= 1; k++) {
        double lat = geographic(world, middle + k * half), sine = world->e * sin(lat);
        sum += (k == 0 ? 8.0 : 5.0) / 18.0 * sqrt(1.0 - sine * sine) / cos(lat);
    }
    return sum * world->rectifying_m / world->earth->radius_m;
}

static void vector(double lon_deg, double lat_deg, double v[3]) {
    v[0] = cos(lat_deg * DEGREE) * cos(lon_deg * DEGREE), v[1] = cos(lat_deg * DEGREE) * sin(lon_deg * DEGREE);
    v[2] = sin(lat_deg * DEGREE);
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void ride_circle(const World *world, int64_t piece, Rider *rider) {
    const Pieces *pieces = world->pieces;
    const double *start = pieces->leg_start_deg + 2 * piece, *end = pieces->leg_end_deg + 2 * piece;
    double to[3], normal[3];
    vector(start[0], start[1], rider->from), vector(end[0], end[1], to);
    for (int k = 0; k < 3; k++) normal[k] = rider->from[(k + 1) % 3] * to[(k + 2) % 3] - rider->from[(k + 2) % 3] * to[(k + 1) % 3];
    double sine = sqrt(dot(normal, normal));
    rider->angle = atan2(sine, dot(rider->from, to));
    if (start[0] == end[0] && start[1] == end[1]) { /* a loiter: along its bearing */
        double lon = start[0] * DEGREE, lat = start[1] * DEGREE, b = pieces->bearing_deg[piece] * DEGREE;
        double east[3] = {-sin(lon), cos(lon), 0.0}, north[3] = {-sin(lat) * cos(lon), -sin(lat) * sin(lon), cos(lat)};
        for (int k = 0; k < 3; k++) rider->along[k] = sin(b) * east[k] + cos(b) * north[k];
        rider->angle = 0.0;
    } else {
        for (int k = 0; k < 3; k++) normal[k] /= sine;
        for (int k = 0; k < 3; k++)
            rider->along[k] = normal[(k + 1) % 3] * rider->from[(k + 2) % 3] - normal[(k + 2) % 3] * rider->from[(k + 1) % 3];
    }
    for (int k = 0; k < 3; k++) /* to starboard: along x from */
        rider->across[k] = rider->along[(k + 1) % 3] * rider->from[(k + 2) % 3] - rider->along[(k + 2) % 3] * rider->from[(k + 1) % 3];
}

static void ride_rhumb(const World *world, int64_t piece, Rider *rider) {
    const Pieces *pieces = world->pieces;
    const double *start = pieces->leg_start_deg + 2 * piece, *end = pieces->leg_end_deg + 2 * piece;
    rider->mu0 = rectifying(world, start[1] * DEGREE), rider->mu1 = rectifying(world, end[1] * DEGREE);
    rider->lon0 = (start[0] + 360.0 * pieces->turn[piece]) * DEGREE, rider->lon1 = (end[0] + 360.0 * pieces->turn[piece]) * DEGREE;
    rider->way = stretch(world, rider->mu0, isometric(world, rider->mu0), rider->mu1, isometric(world, rider->mu1), 1e-2);
    rider->east = (rider->lon1 - rider->lon0) / rider->way, rider->north = rider->mu1 - rider->mu0;
    double length = hypot(rider->east, rider->north);
    if (length > 0.0) {
        rider->east /= length, rider->north /= length;
    } else {
        rider->east = sin(pieces->bearing_deg[piece] * DEGREE), rider->north = cos(pieces->bearing_deg[piece] * DEGREE);
    }
}

static Rider rider_of(const World *world, int64_t piece, int64_t zero_us) {
    const Pieces *pieces = world->pieces;
    Rider rider = {.moves = pieces->moves[piece], .first = pieces->offset[piece]};
    rider.count = pieces->offset[piece + 1] - rider.first;
    if (!rider.moves) {
        rider.lon0 = 6.283185307179586 * pieces->turn[piece] * (world->earth->is_gnomonic ? 0.0 : world->earth->radius_m);
        return rider;
    }
    rider.leg_s = (double)(pieces->leg_end_us[piece] - pieces->leg_start_us[piece]) / 1e6;
    rider.zero_s = (double)(zero_us - pieces->leg_start_us[piece]) / 1e6;
    if (world->earth->is_gnomonic) ride_circle(world, piece, &rider);
    else ride_rhumb(world, piece, &rider);
    return rider;
}

static void place_on_circle(const World *world, const Rider *rider, double gone, double aside, double ahead, double *x, double *y) {
    double radius_m = world->earth->radius_m, s = aside / radius_m, f = gone * rider->angle + ahead / radius_m, v[3];
    for (int k = 0; k < 3; k++) v[k] = cos(s) * (cos(f) * rider->from[k] + sin(f) * rider->along[k]) + sin(s) * rider->across[k];
    double up = dot(v, world->centre);
    *x = radius_m * dot(v, world->to_east) / up, *y = radius_m * dot(v, world->to_north) / up;
}

static void place(const World *world, const Rider *rider, double t, Shape *shape) {
    const double *xy = world->pieces->shape + 2 * rider->first, *to = world->pieces->shape_to + 2 * rider->first;
    double a = world->earth->radius_m, gone = (rider->zero_s + t) / rider->leg_s, mu = 0.0, psi = 0.0, lon = 0.0;
    shape->count = (int)rider->count;
    if (!rider->moves) {
        for (int i = 0; i < shape->count; i++) shape->x[i] = xy[2 * i] + rider->lon0, shape->y[i] = xy[2 * i + 1];
        return;
    }
    if (!world->earth->is_gnomonic) {
        mu = rider->mu0 + gone * (rider->mu1 - rider->mu0), psi = isometric(world, mu);
        double way = stretch(world, rider->mu0, isometric(world, rider->mu0), mu, psi, 1e-2);
        lon = rider->lon0 + gone * (rider->lon1 - rider->lon0) * way / rider->way;
    }
    for (int i = 0; i < shape->count; i++) {
        double aside = xy[2 * i] + gone * (to[2 * i] - xy[2 * i]), ahead = xy[2 * i + 1] + gone * (to[2 * i + 1] - xy[2 * i + 1]);
        if (world->earth->is_gnomonic) {
            place_on_circle(world, rider, gone, aside, ahead, shape->x + i, shape->y + i);
            continue;
        }
        ahead /= world->rectifying_m, aside /= world->rectifying_m;
        double mu1 = mu + ahead * rider->north, mu2 = mu1 - aside * rider->east;
        double psi1 = isometric(world, mu1), psi2 = isometric(world, mu2);
        double first = stretch(world, mu, psi, mu1, psi1, 1e-4), second = stretch(world, mu1, psi1, mu2, psi2, 1e-4);
        shape->x[i] = a * (lon + ahead * rider->east * first + aside * rider->north * second);
        shape->y[i] = a * psi2;
    }
}

/* The hull of a shape, in place, counter-clockwise (Andrew's monotone chain). */
static void make_hull(Shape *shape) {
    Shape hull;
    int n = shape->count, k = 0;
    for (int i = 1; i < n; i++) /* insertion sort: shapes are small */
        for (int j = i; j > 0 && (shape->x[j] < shape->x[j - 1] || (shape->x[j] == shape->x[j - 1] && shape->y[j] < shape->y[j - 1])); j--) {
            double x = shape->x[j], y = shape->y[j];
            shape->x[j] = shape->x[j - 1], shape->y[j] = shape->y[j - 1], shape->x[j - 1] = x, shape->y[j - 1] = y;
        }
    if (n < 3) return;
    for (int side = 0; side < 2; side++) {
        int from = k;
        for (int m = 0; m < n; m++) {
            int i = side ? n - 1 - m : m;
            while (k >= from + 2 && (hull.x[k - 1] - hull.x[k - 2]) * (shape->y[i] - hull.y[k - 2]) <=
                                        (hull.y[k - 1] - hull.y[k - 2]) * (shape->x[i] - hull.x[k - 2])) k--;
            hull.x[k] = shape->x[i], hull.y[k++] = shape->y[i];
        }
        k--; /* the last of one chain is the first of the other */
    }
    shape->count = k > 0 ? k : 1;
    for (int i = 0; i < k; i++) shape->x[i] = hull.x[i], shape->y[i] = hull.y[i];
}

/* The gap between two shapes along an axis. */
static double gap_along(const Shape *a, const Shape *b, double x, double y) {
    double most_a = -INFINITY, least_b = INFINITY, length = hypot(x, y);
    for (int i = 0; i < a->count; i++) most_a = fmax(most_a, a->x[i] * x + a->y[i] * y);
    for (int i = 0; i < b->count; i++) least_b = fmin(least_b, b->x[i] * x + b->y[i] * y);
    return length > 0.0 ? (least_b - most_a) / length : -INFINITY;
}

/* The largest gap along the normals of a's sides; of what has no inside also along it. */
static double gap_of(const Shape *a, const Shape *b) {
    double gap = -INFINITY;
    for (int i = 0; i < a->count; i++) {
        int j = (i + 1) % a->count;
        double x = a->x[j] - a->x[i], y = a->y[j] - a->y[i];
        gap = fmax(gap, gap_along(a, b, y, -x));
        if (a->count == 2) gap = fmax(gap, gap_along(a, b, x, y));
        if (a->count == 1) gap = fmax(gap, gap_along(a, b, b->x[0] - a->x[0], b->y[0] - a->y[0]));
    }
    return gap;
}

typedef struct {
    const World *world;
    const Claims *claims;
    int64_t pair;
    Rider a, b;
    Findings *found;
} Watch;

static void blame(Watch *watch, int kind, double t, double gap) {
    Findings *found = watch->found;
    if (found->wrong < 16) {
        found->pair[found->wrong] = watch->pair, found->kind[found->wrong] = kind;
        found->at_s[found->wrong] = t, found->gap_m[found->wrong] = gap;
    }
    found->wrong++;
}

static double scale_at(const World *world, double x, double y) {
    double r = world->earth->radius_m;
    return world->earth->is_gnomonic ? 1.0 + (x * x + y * y) / (r * r) : cosh(y / r);
}

/* The gap at t, in metres on the earth or more; below 0 as deep as they overlap. Blames what is claimed of t. */
static double sample(Watch *watch, double t) {
    Shape a, b;
    place(watch->world, &watch->a, t, &a), place(watch->world, &watch->b, t, &b);
    double scale = fmax(scale_at(watch->world, a.x[0], a.y[0]), scale_at(watch->world, b.x[0], b.y[0]));
    make_hull(&a), make_hull(&b);
    double gap = fmax(gap_of(&a, &b), gap_of(&b, &a));
    bool is_covered = false, is_inside = false;
    for (int64_t k = watch->claims->offset[watch->pair]; k < watch->claims->offset[watch->pair + 1]; k++) {
        double start = watch->claims->start_s[k], end = watch->claims->end_s[k], error = watch->claims->error_s[k];
        is_covered |= start <= t && t <= end;
        is_inside |= watch->claims->is_certain[k] && start + error <= t && t <= end - error;
    }
    watch->found->samples++;
    watch->found->overlapping += gap < 0.0;
    if (gap < -TOLERANCE_M * scale && !is_covered) blame(watch, 1, t, gap);
    if (gap > TOLERANCE_M * scale && is_inside) blame(watch, 2, t, gap);
    return gap;
}

/* The least gap that a search between two instants comes upon: it need not be the least there is. */
static double nearest(Watch *watch, double low, double high) {
    double least = INFINITY;
    for (int k = 0; k < STEPS && high > low; k++) {
        double one = low + 0.382 * (high - low), other = low + 0.618 * (high - low);
        double at_one = sample(watch, one), at_other = sample(watch, other);
        least = fmin(least, fmin(at_one, at_other));
        if (at_one < at_other) high = other;
        else low = one;
    }
    return least;
}

/* At most how fast the two go against each other, roughly: twice what samples show. */
static double speed_of(const Watch *watch, double low, double high) {
    Shape before, now;
    double speed = 0.0;
    const Rider *riders[] = {&watch->a, &watch->b};
    for (int r = 0; r < 2; r++) {
        double fastest = 0.0;
        for (int k = 0; riders[r]->moves && k < 4; k++) {
            place(watch->world, riders[r], low + 0.25 * k * (high - low), &before);
            place(watch->world, riders[r], low + 0.25 * (k + 1) * (high - low), &now);
            for (int i = 0; i < now.count; i++) fastest = fmax(fastest, hypot(now.x[i] - before.x[i], now.y[i] - before.y[i]));
        }
        speed += 2.0 * fastest / (0.25 * (high - low));
    }
    return speed;
}

static void watch_pair(Watch *watch, double low, double high, double share) {
    double step = (high - low) / SAMPLES, before = INFINITY, now = INFINITY;
    double speed = high > low ? speed_of(watch, low, high) : 0.0;
    sample(watch, low), sample(watch, high);
    for (double t = low + share * step, last = low; t < high; ) {
        double gap = sample(watch, t);
        /* Nearer before and after: what is between? */
        if (now > 0.0 && now <= before && now < gap && now < speed * step) nearest(watch, fmax(last - step, low), fmin(t, high));
        before = now, now = gap, last = t;
        t += gap > speed * step ? gap / speed : step;
        if (speed == 0.0) break;
    }
    for (int64_t k = watch->claims->offset[watch->pair]; k < watch->claims->offset[watch->pair + 1]; k++) {
        double start = fmax(watch->claims->start_s[k], low), end = fmin(watch->claims->end_s[k], high);
        double error = watch->claims->error_s[k], least = INFINITY;
        double inside[] = {start + error, 0.5 * (start + end), end - error};
        if (start - ASIDE_S >= low) sample(watch, start - ASIDE_S);
        if (end + ASIDE_S <= high) sample(watch, end + ASIDE_S);
        for (int j = 0; j < 3; j++) least = fmin(least, sample(watch, fmin(fmax(inside[j], start), end)));
        if (!watch->claims->is_certain[k] || least < 0.0) continue;
        least = fmin(least, nearest(watch, start, end));
        if (least > TOLERANCE_M) blame(watch, 3, 0.5 * (start + end), least);
    }
}

static World world_of(const Earth *earth, const Pieces *pieces) {
    double f = earth->flattening, n = f / (2.0 - f);
    World world = {.earth = earth, .pieces = pieces, .n = n, .e = sqrt(f * (2.0 - f))};
    world.rectifying_m = earth->radius_m / (1.0 + n) * (1.0 + n * n / 4.0 + n * n * n * n / 64.0);
    double lon = earth->centre_lon_deg * DEGREE, lat = earth->centre_lat_deg * DEGREE;
    vector(earth->centre_lon_deg, earth->centre_lat_deg, world.centre);
    world.to_east[0] = -sin(lon), world.to_east[1] = cos(lon);
    world.to_north[0] = -sin(lat) * cos(lon), world.to_north[1] = -sin(lat) * sin(lon), world.to_north[2] = cos(lat);
    return world;
}

/* Hold what is claimed of pairs against samples. share: (count,) in [0, 1), where the first sample of each lies. */
int sampling_check(const Earth *earth, const Pieces *pieces, int64_t count, const int64_t *a, const int64_t *b,
                const int64_t *zero_us, const double *low_s, const double *high_s, const double *share,
                const Claims *claims, Findings *found) {
    World world = world_of(earth, pieces);
    for (int64_t i = 0; i < count; i++) {
        if (pieces->offset[a[i] + 1] - pieces->offset[a[i]] > MOST_VERTICES / 2) return 1;
        if (pieces->offset[b[i] + 1] - pieces->offset[b[i]] > MOST_VERTICES / 2) return 1;
        Watch watch = {&world, claims, i, rider_of(&world, a[i], zero_us[i]), rider_of(&world, b[i], zero_us[i]), found};
        watch_pair(&watch, low_s[i], high_s[i], share[i]);
    }
    return 0;
}

/* Put the vertices of a piece where they are at t; xy: (its vertices, 2). */
void sampling_place(const Earth *earth, const Pieces *pieces, int64_t piece, int64_t zero_us, double t, double *xy) {
    World world = world_of(earth, pieces);
    Rider rider = rider_of(&world, piece, zero_us);
    Shape shape;
    place(&world, &rider, t, &shape);
    for (int i = 0; i < shape.count; i++) xy[2 * i] = shape.x[i], xy[2 * i + 1] = shape.y[i];
}
