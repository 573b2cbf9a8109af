/* Havens that move along rhumb lines, in the Mercator plane.
 *
 * A haven moves along its line at constant speed. A vertex is reached from the reference point by two rhumb steps
 * (which do not commute): f forward, then s to starboard of the heading (e, n). With S1 and S2 the divided differences
 * of psi over their latitudes, its offset is a (f S1 (e, n) + s S2 (n, -e)). No bearing is a special case, and no
 * digits cancel. S1 and S2 depend on time only through the latitude of the reference point; they are power series in
 * the haven's size. If the haven changes shape, f and s are linear in time.
 *
 * Bienkowski, Sidoti, Pattipati, IEEE Access 2021, section III, except that the image in the plane is not treated as
 * rigid.
 */
#include <stddef.h>

#include "planes/motion.h"
#include "planes/plane.h"

/* Bounds on curvature are derived for the sphere. On WGS84 d chi / d mu differs from 1 by at most n = 0.0017, and its
 * derivatives by at most 4 n relative to tan: (1 + n)^3 (1 + 4 n) (1 + 8 n) < 1.03, rounded up. */
static const double ELLIPSOID_SLACK = 1.05;
/* Largest ratio q of size (of a haven, or of a time with the haven about its middle) to distance from the pole for each
 * number of terms: k terms leave out q^(k + 1) / (k + 1), below 1e-10 m. For a longer time the series is computed at
 * each instant; for a larger haven the closed form is used. */
static const double REACH_OF[] = {0.0005, 0.002, 0.005, 0.01, 0.017, 0.026, 0.036, 0.048, 0.06, 0.075, 0.09, 0.105, 0.12};
enum { REACHES = sizeof REACH_OF / sizeof *REACH_OF, FEWEST_TERMS = EARTH_TERMS + 1 - REACHES };
/* A corner stays convex in the plane if it turns by this multiple of what its sides bend. */
static const double CORNER_SLACK = 4.0;
static const double RADIANS = 0x1.1df46a2529d39p-6; /* pi / 180 */
static const double HALF_PI = 0x1.921fb54442d18p0;

typedef struct {
    double up, down, step;
} Extents;

static Extents extents_of(const double *shape, const Body *body, double unit_m) {
    Extents found = {0.0, 0.0, 0.0};
    double east = body->leg.rhumb.east, north = body->leg.rhumb.north;
    for (int64_t i = body->first; i < body->first + body->count; i++) {
        double starboard = shape[2 * i] / unit_m, forward = shape[2 * i + 1] / unit_m;
        double first = forward * north, second = first - starboard * east;
        found.up = most(found.up, most(first, second));
        found.down = least(found.down, least(first, second));
        found.step = most(found.step, fabs(forward * east) + fabs(starboard * north));
    }
    return found;
}

/* Whether a corner may become reflex in the plane. Along a side of length d the plane's axes turn relative to the
 * haven's, and the scale changes, by at most d tan(latitude). */
static bool may_dent(const KernelPieces *pieces, const Body *body, double unit_m, double tangent) {
    if (body->count <= 3) return false;
    for (int64_t i = 0; i < body->count; i++) {
        Corner corner = corner_of(pieces, body, i, unit_m);
        double side = most(norm(corner.side), norm(corner.last_side));
        double next = most(norm(corner.next), norm(corner.last_next));
        double turn = corner.changes ? corner_least_turn(&corner) : fabs(cross(corner.side, corner.next));
        double allowed = CORNER_SLACK * (side + next) * tangent + CORNER_SLACK * 1e-9;
        if (!(turn > allowed * side * next)) return true;
    }
    return false;
}

/* Number of terms for a size and a distance from the pole; 0 if a series does not suffice. */
static int64_t terms_for(double size, double to_pole) {
    for (int k = 0; k < REACHES; k++)
        if (size <= REACH_OF[k] * to_pole) return FEWEST_TERMS + k;
    return 0;
}

/* The rates of a haven that changes shape, and bounds on them. */
static void prepare_change(const Scene *scene, const KernelPieces *pieces, Body *body, Extents at_start) {
    RhumbLeg *leg = &body->leg.rhumb;
    double unit_m = scene->plane.rectifying_m, own = leg->delta_mu / leg->leg_s;
    Extents at_end = extents_of(pieces->shape_to, body, unit_m);
    leg->up_rate = (at_end.up - at_start.up) / leg->leg_s;
    leg->down_rate = (at_end.down - at_start.down) / leg->leg_s;
    leg->step_rate = (at_end.step - at_start.step) / leg->leg_s;
    double *forward_rate = scene->columns + FORWARD_RATE * scene->vertex_count;
    double *starboard_rate = scene->columns + STARBOARD_RATE * scene->vertex_count;
    for (int64_t i = body->first; i < body->first + body->count; i++) {
        starboard_rate[i] = (pieces->shape_to[2 * i] / unit_m - pieces->shape[2 * i] / unit_m) / leg->leg_s;
        forward_rate[i] = (pieces->shape_to[2 * i + 1] / unit_m - pieces->shape[2 * i + 1] / unit_m) / leg->leg_s;
        double first = forward_rate[i] * leg->north, second = first - starboard_rate[i] * leg->east;
        leg->fastest = most(leg->fastest, most(fabs(own + first), fabs(own + second)));
        leg->climb = most(leg->climb, fabs(second));
        leg->widen = most(leg->widen, fabs(forward_rate[i] * leg->east) + fabs(starboard_rate[i] * leg->north));
    }
}

/* Compute the series about the leg's place at an instant, seconds of the leg. */
static void make_series(const KernelPlane *earth, const RhumbLeg *leg, double at_s, RhumbSeries *about) {
    double gone = at_s / leg->leg_s, mu = leg->start_mu + gone * leg->delta_mu;
    double way = gone * earth_stretch(earth, leg->start_mu, mu);
    about->at_s = at_s;
    about->place.x = leg->start.x + leg->rate_x * way;
    about->place.y = leg->start.y + earth->radius_m * leg->delta_mu * way;
    earth_series(earth, mu, about->terms, about->series);
}

bool rhumb_prepare(const Scene *scene, const KernelPieces *pieces, int64_t piece, Body *body) {
    const KernelPlane *earth = &scene->plane;
    RhumbLeg *leg = &body->leg.rhumb;
    double unit_m = earth->rectifying_m, size = 0.0;
    double lon0 = RADIANS * pieces->leg_start_deg[2 * piece], lon1 = RADIANS * pieces->leg_end_deg[2 * piece];
    double end_mu = earth_rectifying(earth, RADIANS * pieces->leg_end_deg[2 * piece + 1]);
    body->motion = ON_RHUMB_LINE;
    leg->leg_s = (double)(pieces->leg_end_us[piece] - pieces->leg_start_us[piece]) / 1e6;
    leg->start_mu = earth_rectifying(earth, RADIANS * pieces->leg_start_deg[2 * piece + 1]);
    leg->delta_mu = end_mu - leg->start_mu;
    leg->rate_x = earth->radius_m * (lon1 - lon0) / earth_stretch(earth, leg->start_mu, end_mu);
    earth_direction(pieces->bearing_deg[piece], &leg->east, &leg->north);
    leg->start.x = earth->radius_m * (lon0 + 4.0 * HALF_PI * pieces->turn[piece]);
    leg->start.y = earth->radius_m * earth_isometric(earth, leg->start_mu);
    leg->fastest = fabs(leg->delta_mu) / leg->leg_s;
    body->origin = leg->start;
    double *forward = scene->columns + FORWARD * scene->vertex_count;
    double *starboard = scene->columns + STARBOARD * scene->vertex_count;
    for (int64_t i = body->first; i < body->first + body->count; i++) {
        starboard[i] = pieces->shape[2 * i] / unit_m, forward[i] = pieces->shape[2 * i + 1] / unit_m;
        size = most(size, hypot(starboard[i], forward[i]));
        if (body->changes) size = most(size, hypot(pieces->shape_to[2 * i], pieces->shape_to[2 * i + 1]) / unit_m);
    }
    Extents at_start = extents_of(pieces->shape, body, unit_m);
    leg->up = at_start.up, leg->down = at_start.down, leg->step = at_start.step;
    if (body->changes) prepare_change(scene, pieces, body, at_start);

    double highest = most(fabs(leg->start_mu), fabs(end_mu)), to_pole = HALF_PI - highest;
    double slice_us = (double)(pieces->end_us[piece] - pieces->start_us[piece]);
    double half_slice = 0.5 * fabs(leg->delta_mu) * slice_us / (1e6 * leg->leg_s);
    body->is_convex = !may_dent(pieces, body, unit_m, tan(least(highest + size, 1.57)));
    leg->size = size, leg->order = terms_for(size, to_pole);
    leg->about_slice.terms = terms_for(half_slice + size, to_pole);
    if (leg->about_slice.terms > 0) {
        double start_s = (double)(pieces->start_us[piece] - pieces->leg_start_us[piece]) / 1e6;
        double end_s = (double)(pieces->end_us[piece] - pieces->leg_start_us[piece]) / 1e6;
        make_series(earth, leg, 0.5 * (start_s + end_s), &leg->about_slice);
    }
    /* No vertex or step may reach a pole. Latitudes are linear in time, so checking both ends of the leg suffices. */
    double north = most(leg->start_mu + leg->up, end_mu + leg->up + leg->up_rate * leg->leg_s);
    double south = least(leg->start_mu + leg->down, end_mu + leg->down + leg->down_rate * leg->leg_s);
    bool is_off_poles = north < HALF_PI && south > -HALF_PI;
    return leg->leg_s > 0.0 && is_off_poles && isfinite(leg->rate_x) && isfinite(leg->east + leg->north);
}

void rhumb_focus(Mover *mover, double t0, double t1) {
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    if (leg->order == 0 || leg->about_slice.terms > 0 || mover->near.terms > 0) return;
    double first = mover->into_s + t0, last = mover->into_s + t1, half_s = 0.5 * (last - first);
    double mu0 = leg->start_mu + first / leg->leg_s * leg->delta_mu, mu1 = leg->start_mu + last / leg->leg_s * leg->delta_mu;
    mover->near.terms = terms_for(0.5 * fabs(mu1 - mu0) + leg->size, HALF_PI - most(fabs(mu0), fabs(mu1)));
    if (mover->near.terms == 0) return;
    /* At least the terms that the haven needs where the leg is nearest to the pole. */
    if (mover->near.terms < leg->order) mover->near.terms = leg->order;
    mover->near_s = half_s * (1.0 + 1e-9);
    make_series(&mover->scene->plane, leg, first + half_s, &mover->near);
}

/* The series valid at the instant t of a mover, or NULL. */
static const RhumbSeries *series_at(const Mover *mover, double t) {
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    if (leg->about_slice.terms > 0) return &leg->about_slice;
    bool is_near = mover->near.terms > 0 && fabs(t - (mover->near.at_s - mover->into_s)) <= mover->near_s;
    return is_near ? &mover->near : NULL;
}

/* The divided difference over d of a power series, and its first coefficients about d: repeated Horner's scheme (Shaw,
 * Traub, J. ACM 21 (1974), doi:10.1145/321812.321828). */
static double shifted(const RhumbSeries *about, double d, int64_t order, double found[EARTH_TERMS]) {
    int64_t last = about->terms - 1;
    found[last] = about->series[last];
    for (int64_t k = last - 1; k >= 0; k--) found[k] = about->series[k] + found[k + 1] * d;
    double difference = found[0];
    for (int64_t lowest = 0; lowest < order; lowest++)
        for (int64_t k = last - 1; k >= lowest; k--) found[k] += found[k + 1] * d;
    return difference;
}

/* The reference point at t, and the power series of psi there if the haven uses one. */
static Vector place_reference(const Mover *mover, double t, double series[EARTH_TERMS]) {
    const KernelPlane *earth = &mover->scene->plane;
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    double into = mover->into_s + t, way;
    Vector from = leg->start;
    const RhumbSeries *about = series_at(mover, t);
    if (about) {
        double gone = (t - (about->at_s - mover->into_s)) / leg->leg_s;
        way = gone * shifted(about, gone * leg->delta_mu, leg->order, series);
        from = about->place;
    } else {
        double mu = leg->start_mu + into / leg->leg_s * leg->delta_mu;
        way = into / leg->leg_s * earth_stretch(earth, leg->start_mu, mu);
        if (leg->order > 0) earth_series(earth, mu, leg->order, series);
    }
    return (Vector){leg->rate_x * way + (from.x - mover->origin.x),
                    earth->radius_m * leg->delta_mu * way + (from.y - mover->origin.y)};
}

Vector rhumb_reference(const Mover *mover, double t) {
    double series[EARTH_TERMS];
    return place_reference(mover, t, series);
}

void rhumb_place(const Mover *mover, double t, Polygon *polygon) {
    const KernelPlane *earth = &mover->scene->plane;
    const Body *body = mover->body;
    const RhumbLeg *leg = &body->leg.rhumb;
    const double *forward = body_column(mover->scene, body, FORWARD);
    const double *starboard = body_column(mover->scene, body, STARBOARD);
    const double *forward_rate = body_column(mover->scene, body, FORWARD_RATE);
    const double *starboard_rate = body_column(mover->scene, body, STARBOARD_RATE);
    double series[EARTH_TERMS], into = mover->into_s + t, mu = leg->start_mu + into / leg->leg_s * leg->delta_mu;
    Vector reference = place_reference(mover, t, series);
    for (int64_t i = 0; i < body->count; i++) {
        double ahead = forward[i], aside = starboard[i], first, second;
        if (body->changes) ahead += forward_rate[i] * into, aside += starboard_rate[i] * into;
        double d1 = ahead * leg->north, d2 = d1 - aside * leg->east;
        if (leg->order > 0) {
            /* The series at 0 and d1, and from its steps the divided difference at 0, d1 and d2. */
            first = second = series[leg->order - 1];
            for (int64_t k = leg->order - 2; k >= 0; k--) {
                first = first * d1 + series[k];
                second = second * d2 + first;
            }
        } else {
            first = earth_stretch(earth, mu, mu + d1), second = earth_stretch(earth, mu + d1, mu + d2);
        }
        first *= earth->radius_m * ahead, second *= earth->radius_m * aside;
        polygon->x[i] = reference.x + (first * leg->east + second * leg->north);
        polygon->y[i] = reference.y + (first * leg->north - second * leg->east);
    }
}

Vector rhumb_velocity(const Mover *mover, double t) {
    const KernelPlane *earth = &mover->scene->plane;
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    const RhumbSeries *about = series_at(mover, t);
    double slope[EARTH_TERMS];
    if (about) shifted(about, (t - (about->at_s - mover->into_s)) / leg->leg_s * leg->delta_mu, 1, slope);
    else slope[0] = earth_slope(earth, leg->start_mu + (mover->into_s + t) / leg->leg_s * leg->delta_mu);
    double rate = slope[0] / leg->leg_s;
    return (Vector){rate * leg->rate_x, rate * earth->radius_m * leg->delta_mu};
}

/* Extremes of a haven during a time: latitudes of the reference point at both ends; up, down and step (RhumbLeg); and
 * the highest latitude, north or south, of any vertex or step. All latitudes are linear in time. */
typedef struct {
    double mu0, mu1, up, down, step, highest;
} Reach;

static Reach reach_of(const Mover *mover, double t0, double t1) {
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    double first = mover->into_s + t0, last = mover->into_s + t1;
    Reach reach = {leg->start_mu + first / leg->leg_s * leg->delta_mu,
                   leg->start_mu + last / leg->leg_s * leg->delta_mu,
                   leg->up,
                   leg->down,
                   leg->step,
                   0.0};
    double north = most(reach.mu0, reach.mu1) + leg->up, south = least(reach.mu0, reach.mu1) + leg->down;
    if (mover->body->changes) {
        north = most(reach.mu0 + (leg->up + leg->up_rate * first), reach.mu1 + (leg->up + leg->up_rate * last));
        south = least(reach.mu0 + (leg->down + leg->down_rate * first), reach.mu1 + (leg->down + leg->down_rate * last));
        reach.up += most(leg->up_rate * first, leg->up_rate * last);
        reach.down += least(leg->down_rate * first, leg->down_rate * last);
        reach.step += most(leg->step_rate * first, leg->step_rate * last);
    }
    reach.highest = most(north, -south);
    return reach;
}

bool rhumb_is_there(const Mover *mover, double t0, double t1) { return reach_of(mover, t0, t1).highest < HALF_PI; }

/* A bound on the second derivative of the steps east or west, plane m/s^2. */
static double step_acceleration(const Mover *mover, const Reach *reach, double secant, double tangent) {
    double w = mover->body->leg.rhumb.fastest, widen = mover->body->leg.rhumb.widen;
    return mover->scene->plane.radius_m *
           (w * w * reach->step * secant * (1.0 + 2.0 * tangent * tangent) + 2.0 * widen * w * secant * tangent);
}

/* All latitudes are linear in time, and the bounds increase with latitude: evaluate them at the highest latitude.
 * Acceleration: y = a psi(mu) has y'' = a mu'^2 sec tan, the reference point x'' = rate_x mu' sec tan / leg_s, and a
 * step f moves x = a f D with (f D)'' = 2 f' D' + f D'', |D'| <= w sec tan, |D''| <= w^2 sec (1 + 2 tan^2).
 * Spread: the offset of a vertex changes by at most a w step sec tan in x and a w max(up, -down) sec tan in y, plus a
 * sec times the growth of its steps and latitude; plus the acceleration times half of the time. */
Bounds rhumb_bounds(const Mover *mover, double t0, double t1) {
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    double radius_m = mover->scene->plane.radius_m;
    Reach reach = reach_of(mover, t0, t1);
    double tangent = tan(reach.highest), secant = sqrt(1.0 + tangent * tangent);
    double own = fabs(leg->delta_mu) / leg->leg_s, w = leg->fastest;
    double y = radius_m * w * w * secant * tangent;
    double x = fabs(leg->rate_x) * own / leg->leg_s * secant * tangent;
    x += step_acceleration(mover, &reach, secant, tangent);
    double acceleration = ELLIPSOID_SLACK * sqrt(x * x + y * y);
    x = w * reach.step * tangent + leg->widen, y = own * most(reach.up, -reach.down) * tangent + leg->climb;
    double spread = ELLIPSOID_SLACK * radius_m * secant * sqrt(x * x + y * y);
    return (Bounds){acceleration, spread + 0.5 * acceleration * (t1 - t0)};
}

/* A bound on the second derivative of any vertex's northing relative to the reference point, plane m/s^2: that of a
 * (psi(mu2) - psi(mu)) is a (mu2'^2 psi''(mu2) - mu'^2 psi''(mu)), at most a (|mu2' - mu'| 2 w sec tan + mu'^2 d sec (1
 * + 2 tan^2)), d the vertex's latitude minus mu. */
static double north_acceleration(const Mover *mover, const Reach *reach, double secant, double tangent) {
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    double own = leg->delta_mu / leg->leg_s, d = most(reach->up, -reach->down);
    double y = 2.0 * leg->climb * leg->fastest * tangent + own * own * d * (1.0 + 2.0 * tangent * tangent);
    return mover->scene->plane.radius_m * secant * y;
}

/* The reference point has x'' = rate_x mu' psi'' / leg_s and y'' = a mu'^2 psi''; psi''' <= sec (1 + 2 tan^2). */
Acceleration rhumb_acceleration(const Mover *mover, double t0, double t1) {
    const KernelPlane *earth = &mover->scene->plane;
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    double series[EARTH_TERMS], own = leg->delta_mu / leg->leg_s, into = mover->into_s + 0.5 * (t0 + t1);
    earth_series(earth, leg->start_mu + into / leg->leg_s * leg->delta_mu, 2, series);
    double x = leg->rate_x / leg->leg_s * own, y = earth->radius_m * own * own, curve = 2.0 * series[1];
    Reach reach = reach_of(mover, t0, t1);
    double tangent = tan(reach.highest), secant = sqrt(1.0 + tangent * tangent);
    double east = step_acceleration(mover, &reach, secant, tangent), north = north_acceleration(mover, &reach, secant, tangent);
    double jerk = hypot(x, y) * fabs(own) * secant * (1.0 + 2.0 * tangent * tangent);
    return (Acceleration){{x * curve, y * curve}, ELLIPSOID_SLACK * (hypot(east, north) + 0.5 * (t1 - t0) * jerk)};
}

/* Deviation of the vertices of a haven of constant shape from the hull of its ends. The reference point moves straight.
 * With p its psi, a vertex's offset o(p) leaves its chord by at most max |o''(p)| (p1 - p0)^2 / 8, where d/dp is
 * cos(mu) d/dmu. With c the largest cos(mu) and M the highest latitude of a vertex: the offset in x, a step sec, has
 * |o''| <= a step (c^2 sec M (1 + 2 tan(M)^2) + c sec M tan M); that in y, a (psi(mu + d) - psi(mu)), |o''| <= a c sin
 * d sec(M)^2. */
static double bent_m(const Mover *mover, const Reach *reach, double secant, double tangent) {
    const KernelPlane *earth = &mover->scene->plane;
    double way = (reach->mu1 - reach->mu0) * earth_stretch(earth, reach->mu0, reach->mu1);
    double lowest = reach->mu0 * reach->mu1 <= 0.0 ? 0.0 : least(fabs(reach->mu0), fabs(reach->mu1)), c = cos(lowest);
    double x = reach->step * (c * c * secant * (1.0 + 2.0 * tangent * tangent) + c * secant * tangent);
    double y = c * sin(most(reach->up, -reach->down)) * secant * secant;
    return earth->radius_m * hypot(x, y) * way * way / 8.0;
}

/* The same for changing shape, in time: an offset leaves its chord by at most |o''| h^2 / 8. The fraction of the path
 * covered differs from that of the time by at most (mu1 - mu0)^2 psi'' / (psi1 - psi0) / 8, which moves the chord by
 * that fraction of the offset's change. */
static double bent_on_the_way_m(const Mover *mover, const Reach *reach, double h, double secant, double tangent,
                                double change) {
    const KernelPlane *earth = &mover->scene->plane;
    double east = step_acceleration(mover, reach, secant, tangent), north = north_acceleration(mover, reach, secant, tangent);
    double bent = hypot(east, north) * h * h / 8.0;
    double furthest = most(fabs(reach->mu0), fabs(reach->mu1)), way = fabs(reach->mu1 - reach->mu0);
    double ahead = way * tan(furthest) / cos(furthest) / earth_stretch(earth, reach->mu0, reach->mu1) / 8.0;
    return bent + least(ahead, 1.0) * change;
}

Sweep rhumb_sweep(const Mover *mover, double t0, double t1, double change) {
    const KernelPlane *earth = &mover->scene->plane;
    Reach reach = reach_of(mover, t0, t1);
    double tangent = tan(reach.highest), secant = sqrt(1.0 + tangent * tangent);
    double bent = mover->body->changes ? bent_on_the_way_m(mover, &reach, t1 - t0, secant, tangent, change)
                                       : bent_m(mover, &reach, secant, tangent);
    /* Two offsets of a vertex never differ by more: for strongly curved legs that are too short to be cut. */
    double whole = 2.0 * earth->radius_m * secant * hypot(reach.step, most(reach.up, -reach.down));
    return (Sweep){ELLIPSOID_SLACK * least(bent, whole),
                   mercator_scale(earth, earth->radius_m * earth_isometric(earth, reach.highest))};
}
