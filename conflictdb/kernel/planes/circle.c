/* Havens that move along great circles of the sphere, in the gnomonic plane about a centre.
 *
 * A haven moves along its circle at constant speed. A vertex is reached from the reference point by two great circle
 * steps: f forward along the leg, then s to starboard across it. If the haven changes shape, f and s are linear in
 * time.
 * In the frame of the centre (east, north, up), a vertex f ahead and s to starboard is
 *     V = cos(s) e + sin(s) S,    e = cos(theta + f) A + sin(theta + f) B,
 * with A, B and S the leg's start, heading and starboard, and theta the angle travelled, radians. In the plane it lies
 * at R (V.x, V.y) / V.up.
 * With a the rate of theta + f, s' that of s, and d = e' / a the direction along the leg,
 *     V' = a cos(s) d + s' (cos(s) S - sin(s) e),    V'' = -(a^2 + s'^2) V + a^2 sin(s) S - 2 a s' sin(s) d.
 * Vectors relative to an origin o of the plane have (V.x, V.y) minus o V.up / R, so that coordinates keep their digits.
 */
#include "planes/motion.h"

static const double RADIANS = 0x1.1df46a2529d39p-6; /* pi / 180 */
/* Lower bound on V.up within a scene: 60 degrees from the centre. */
static const double LEAST_UP = 0.49999999998488504;
/* Largest reach of a haven that changes shape, radians. A vertex farther ahead could be more than a quarter turn from
 * the centre although its leg is not; the bounds would not hold. */
static const double MAX_CHANGING_REACH = 0.5235987755982988;
/* Smallest sine of a corner's turn, so that rounding does not make it reflex. Reach, radians, above which a haven that
 * changes shape is treated as nonconvex. Factor by which a corner must turn more than its sides bend. */
static const double LEAST_TURN = 1e-8, FLAT = 0.5, CORNER_SLACK = 4.0;

static Vector3 sum(double a, Vector3 u, double b, Vector3 v) {
    return (Vector3){a * u.x + b * v.x, a * u.y + b * v.y, a * u.up + b * v.up};
}

static Vector3 cross3(Vector3 u, Vector3 v) {
    return (Vector3){u.y * v.up - u.up * v.y, u.up * v.x - u.x * v.up, u.x * v.y - u.y * v.x};
}

/* A difference of longitudes, wrapped to [-180, 180]. */
static double shorter_way_deg(double turn) { return fabs(turn) > 180.0 ? turn - 360.0 * nearbyint(turn / 360.0) : turn; }

static double turn_deg(const KernelPlane *plane, double lon_deg) {
    double home = lon_deg - 360.0 * nearbyint(lon_deg / 360.0);
    return shorter_way_deg((home == -180.0 ? 180.0 : home) - plane->centre_lon_deg);
}

/* The unit vector of a place, computed from differences to the centre, so that small scenes keep their digits. */
static Vector3 towards(const KernelPlane *plane, double lon_deg, double lat_deg) {
    double turn = turn_deg(plane, lon_deg), sine, cosine, sine0, cosine0, sine_turn, cosine_turn;
    earth_direction(lat_deg, &sine, &cosine);
    earth_direction(plane->centre_lat_deg, &sine0, &cosine0);
    earth_direction(turn, &sine_turn, &cosine_turn);
    double half = sin(RADIANS * (0.5 * turn)), versine = 2.0 * half * half;
    double north = sin(RADIANS * (lat_deg - plane->centre_lat_deg)) + sine0 * cosine * versine;
    return (Vector3){cosine * sine_turn, north, sine0 * sine + cosine0 * cosine * cosine_turn};
}

/* The unit vectors pointing east and north at a place. */
static void compass(const KernelPlane *plane, double lon_deg, double lat_deg, Vector3 *east, Vector3 *north) {
    double sine, cosine, sine0, cosine0, sine_turn, cosine_turn;
    earth_direction(lat_deg, &sine, &cosine);
    earth_direction(plane->centre_lat_deg, &sine0, &cosine0);
    earth_direction(turn_deg(plane, lon_deg), &sine_turn, &cosine_turn);
    *east = (Vector3){cosine_turn, sine0 * sine_turn, -cosine0 * sine_turn};
    *north = (Vector3){-sine * sine_turn, sine0 * sine * cosine_turn + cosine0 * cosine,
                       sine0 * cosine - cosine0 * sine * cosine_turn};
}

/* Whether a corner may become reflex in the plane. Its turn has the same sign wherever the haven is, and as in the
 * plane that touches the sphere at the reference point. */
static bool may_dent(const Scene *scene, const Body *body) {
    const double *f = body_column(scene, body, FORWARD), *s = body_column(scene, body, STARBOARD);
    for (int64_t i = 0; i < body->count && body->count > 2; i++) {
        Vector flat[3];
        for (int64_t k = 0; k < 3; k++) {
            int64_t j = (i + k) % body->count;
            flat[k] = (Vector){tan(s[j]) / cos(f[j]), tan(f[j])};
        }
        Vector side = {flat[1].x - flat[0].x, flat[1].y - flat[0].y}, next = {flat[2].x - flat[1].x, flat[2].y - flat[1].y};
        if (!(cross(side, next) > LEAST_TURN * norm(side) * norm(next))) return true;
    }
    return false;
}

/* The same for a haven that changes shape: within half a radian, a side of length d is turned by less than 4 d
 * tan(reach). */
static bool may_dent_on_the_way(const KernelPieces *pieces, const Body *body, double reach, double unit_m) {
    if (body->count <= 2) return false;
    if (reach > FLAT) return true;
    for (int64_t i = 0; i < body->count; i++) {
        Corner corner = corner_of(pieces, body, i, unit_m);
        double side = most(norm(corner.side), norm(corner.last_side));
        double next = most(norm(corner.next), norm(corner.last_next));
        double bent = CORNER_SLACK * (side + next) * tan(reach);
        if (!(corner_least_turn(&corner) > (bent + LEAST_TURN) * side * next)) return true;
    }
    return false;
}

/* The leg, the shorter way from start to end. A leg of length zero has the piece's heading. */
static void prepare_leg(const KernelPlane *plane, const KernelPieces *pieces, int64_t piece, CircleLeg *leg) {
    double lon0 = pieces->leg_start_deg[2 * piece], lat0 = pieces->leg_start_deg[2 * piece + 1];
    double lon1 = pieces->leg_end_deg[2 * piece], lat1 = pieces->leg_end_deg[2 * piece + 1];
    double turn = shorter_way_deg(lon1 - lon0), half = sin(RADIANS * (0.5 * turn));
    double sine0, cosine0, sine1, cosine1, sine, cosine;
    earth_direction(lat0, &sine0, &cosine0);
    earth_direction(lat1, &sine1, &cosine1);
    earth_direction(turn, &sine, &cosine);
    double to_east = cosine1 * sine, to_north = sin(RADIANS * (lat1 - lat0)) + sine0 * cosine1 * (2.0 * half * half);
    double length = hypot(to_east, to_north), angle = atan2(length, sine0 * sine1 + cosine0 * cosine1 * cosine);
    if (!(length > 0.0)) angle = 0.0, length = 1.0, earth_direction(pieces->bearing_deg[piece], &to_east, &to_north);
    Vector3 east, north;
    compass(plane, lon0, lat0, &east, &north);
    leg->start = towards(plane, lon0, lat0);
    leg->heading = sum(to_east / length, east, to_north / length, north);
    leg->starboard = cross3(leg->heading, leg->start);
    leg->rate = angle / ((double)(pieces->leg_end_us[piece] - pieces->leg_start_us[piece]) / 1e6);
}

/* Store a vertex of a haven of constant shape; false if it is not above the plane on the whole leg (`angle` radians
 * long). */
static bool prepare_vertex(const Scene *scene, const CircleLeg *leg, double angle, int64_t i) {
    double *column = scene->columns + i, s = column[STARBOARD * scene->vertex_count], f = column[FORWARD * scene->vertex_count];
    Vector3 p = sum(cos(s) * cos(f), leg->start, cos(s) * sin(f), leg->heading);
    Vector3 q = sum(cos(s) * cos(f), leg->heading, -cos(s) * sin(f), leg->start);
    double numbers[9] = {
        p.x, p.y, p.up, q.x, q.y, q.up, sin(s) * leg->starboard.x, sin(s) * leg->starboard.y, sin(s) * leg->starboard.up};
    for (int k = 0; k < 9; k++) column[(P + k) * scene->vertex_count] = numbers[k];
    /* The height is a cosine of time: its minimum is at one of the ends. */
    return p.up + numbers[8] > 0.0 && cos(angle) * p.up + sin(angle) * q.up + numbers[8] > 0.0;
}

bool circle_prepare(const Scene *scene, const KernelPieces *pieces, int64_t piece, Body *body) {
    CircleLeg *leg = &body->leg.circle;
    double unit_m = scene->plane.radius_m, reach = 0.0, widest = 0.0;
    double leg_s = (double)(pieces->leg_end_us[piece] - pieces->leg_start_us[piece]) / 1e6;
    bool fits = leg_s > 0.0;
    body->motion = ON_GREAT_CIRCLE;
    prepare_leg(&scene->plane, pieces, piece, leg);
    body->origin = (Vector){unit_m * leg->start.x / leg->start.up, unit_m * leg->start.y / leg->start.up};
    for (int64_t i = body->first; i < body->first + body->count; i++) {
        double *column = scene->columns + i, s = pieces->shape[2 * i] / unit_m, f = pieces->shape[2 * i + 1] / unit_m;
        column[STARBOARD * scene->vertex_count] = s, column[FORWARD * scene->vertex_count] = f;
        reach = most(reach, hypot(s, f)), widest = most(widest, most(fabs(s), fabs(f)));
        if (!body->changes) {
            fits &= prepare_vertex(scene, leg, leg->rate * leg_s, i);
            continue;
        }
        double s1 = pieces->shape_to[2 * i] / unit_m, f1 = pieces->shape_to[2 * i + 1] / unit_m;
        column[STARBOARD_RATE * scene->vertex_count] = (s1 - s) / leg_s;
        column[FORWARD_RATE * scene->vertex_count] = (f1 - f) / leg_s;
        reach = most(reach, hypot(s1, f1)), widest = most(widest, most(fabs(s1), fabs(f1)));
    }
    body->is_convex = body->changes ? !may_dent_on_the_way(pieces, body, reach, unit_m) : !may_dent(scene, body);
    fits &= widest <= (body->changes ? MAX_CHANGING_REACH : 2.0 * MAX_CHANGING_REACH);
    return fits && leg->start.up >= LEAST_UP && isfinite(leg->heading.x + leg->heading.y + leg->heading.up);
}

static Vector3 from_origin(Vector3 v, Vector radii) { return (Vector3){v.x - radii.x * v.up, v.y - radii.y * v.up, v.up}; }

void circle_count_from(Mover *mover) {
    const Scene *scene = mover->scene;
    const Body *body = mover->body;
    Vector radii = {mover->origin.x / scene->plane.radius_m, mover->origin.y / scene->plane.radius_m};
    mover->leg = body->leg.circle;
    mover->leg.start = from_origin(mover->leg.start, radii);
    mover->leg.heading = from_origin(mover->leg.heading, radii);
    mover->leg.starboard = from_origin(mover->leg.starboard, radii);
    if (body->changes) return;
    for (int k = 0; k < 9; k += 3) {
        const double *x = body_column(scene, body, P + k), *y = body_column(scene, body, P + k + 1);
        const double *up = body_column(scene, body, P + k + 2);
        double *frame = mover->frame + k * body->count;
        for (int64_t i = 0; i < body->count; i++) {
            frame[i] = x[i] - radii.x * up[i];
            frame[body->count + i] = y[i] - radii.y * up[i];
            frame[2 * body->count + i] = up[i];
        }
    }
}

/* How far vertex i is forward and to starboard at t, radians. */
static Vector ahead_across(const Mover *mover, int64_t i, double t) {
    Vector body = {body_column(mover->scene, mover->body, FORWARD)[i], body_column(mover->scene, mover->body, STARBOARD)[i]};
    if (mover->body->changes) {
        body.x += body_column(mover->scene, mover->body, FORWARD_RATE)[i] * (mover->into_s + t);
        body.y += body_column(mover->scene, mover->body, STARBOARD_RATE)[i] * (mover->into_s + t);
    }
    return body;
}

static double theta_at(const Mover *mover, double t) { return mover->leg.rate * mover->into_s + mover->leg.rate * t; }

/* The point of the leg at an angle, and the direction along the leg there. */
static Vector3 on_leg(const CircleLeg *leg, double angle) { return sum(cos(angle), leg->start, sin(angle), leg->heading); }
static Vector3 along_leg(const CircleLeg *leg, double angle) { return sum(cos(angle), leg->heading, -sin(angle), leg->start); }

/* Vertex i at t; cosine and sine are those of theta. */
static Vector3 vertex_at(const Mover *mover, int64_t i, double t, double cosine, double sine) {
    if (!mover->body->changes) {
        const double *frame = mover->frame + i;
        int64_t n = mover->body->count;
        return (Vector3){cosine * frame[0] + sine * frame[3 * n] + frame[6 * n],
                         cosine * frame[n] + sine * frame[4 * n] + frame[7 * n],
                         cosine * frame[2 * n] + sine * frame[5 * n] + frame[8 * n]};
    }
    Vector reach = ahead_across(mover, i, t);
    return sum(cos(reach.y), on_leg(&mover->leg, theta_at(mover, t) + reach.x), sin(reach.y), mover->leg.starboard);
}

void circle_place(const Mover *mover, double t, Polygon *polygon) {
    double radius_m = mover->scene->plane.radius_m, theta = theta_at(mover, t), cosine = cos(theta), sine = sin(theta);
    for (int64_t i = 0; i < mover->body->count; i++) {
        Vector3 v = vertex_at(mover, i, t, cosine, sine);
        polygon->x[i] = radius_m * v.x / v.up;
        polygon->y[i] = radius_m * v.y / v.up;
    }
}

/* The plane velocity of a vector v that changes by w per second. */
static Vector projected(double radius_m, Vector3 v, Vector3 w) {
    return (Vector){radius_m * (w.x - v.x / v.up * w.up) / v.up, radius_m * (w.y - v.y / v.up * w.up) / v.up};
}

Vector circle_velocity(const Mover *mover, double t) {
    double theta = theta_at(mover, t), rate = mover->leg.rate;
    Vector3 along = along_leg(&mover->leg, theta);
    return projected(mover->scene->plane.radius_m, on_leg(&mover->leg, theta), sum(rate, along, 0.0, along));
}

static Vector vertex_velocity(const Mover *mover, int64_t i, double t) {
    double theta = theta_at(mover, t), cosine = cos(theta), sine = sin(theta), rate = mover->leg.rate;
    Vector3 v = vertex_at(mover, i, t, cosine, sine);
    if (!mover->body->changes) {
        const double *frame = mover->frame + i;
        int64_t n = mover->body->count;
        Vector3 w = {rate * (cosine * frame[3 * n] - sine * frame[0]), rate * (cosine * frame[4 * n] - sine * frame[n]),
                     rate * (cosine * frame[5 * n] - sine * frame[2 * n])};
        return projected(mover->scene->plane.radius_m, v, w);
    }
    double ahead_rate = body_column(mover->scene, mover->body, FORWARD_RATE)[i];
    double across_rate = body_column(mover->scene, mover->body, STARBOARD_RATE)[i];
    Vector reach = ahead_across(mover, i, t);
    Vector3 across = sum(cos(reach.y), mover->leg.starboard, -sin(reach.y), on_leg(&mover->leg, theta + reach.x));
    Vector3 w = sum((rate + ahead_rate) * cos(reach.y), along_leg(&mover->leg, theta + reach.x), across_rate, across);
    return projected(mover->scene->plane.radius_m, v, w);
}

/* How far C.V may sag below its chord on a path that turns V by these angles: C the centre, sine the largest |sin s|.
 * (C.V)'' = -a^2 cos(s) C.e - s'^2 C.V - 2 a s' sin(s) C.d, a the rate of theta + f and d the direction along the leg.
 * Only positive terms count; C.e is not negative within MAX_CHANGING_REACH. */
static double sag(double turn, double across, double sine) {
    return (2.0 * fabs(turn * across) * sine + across * across) / 8.0;
}

/* Extremes of vertex i during a time: the largest |f|, |s| and cos(s), and the smallest C.V. For constant shape C.V is
 * a cosine of time, smallest at one of the ends. */
typedef struct {
    double ahead, across, cosine, up;
} Reach;

static Reach vertex_reach(const Mover *mover, int64_t i, double t0, double t1) {
    double theta0 = theta_at(mover, t0), theta1 = theta_at(mover, t1);
    Vector reach0 = ahead_across(mover, i, t0), reach1 = ahead_across(mover, i, t1);
    double nearest = reach0.y * reach1.y <= 0.0 ? 0.0 : least(fabs(reach0.y), fabs(reach1.y));
    Reach reach = {most(fabs(reach0.x), fabs(reach1.x)), most(fabs(reach0.y), fabs(reach1.y)), cos(nearest), 0.0};
    reach.up =
        least(vertex_at(mover, i, t0, cos(theta0), sin(theta0)).up, vertex_at(mover, i, t1, cos(theta1), sin(theta1)).up);
    if (mover->body->changes) {
        double turn = (mover->leg.rate + body_column(mover->scene, mover->body, FORWARD_RATE)[i]) * (t1 - t0);
        double across = body_column(mover->scene, mover->body, STARBOARD_RATE)[i] * (t1 - t0);
        reach.up = most(reach.up - sag(turn, across, sin(reach.across)), LEAST_UP);
    }
    return reach;
}

/* A bound on the second derivative of vertex i. With J the derivative of the projection, of norm R sec(c)^2 at the
 * angle c from the centre C, and J(V) = 0: x'' = J(V'') - 2 (C.V') / (C.V) x', |C.V'| <= |V'| sin c and |V'|^2 = a^2
 * cos(s)^2 + s'^2. Of S only the component cos(s) counts. So |x''| is at most R sec(c)^2 (a^2 |sin s| cos s + 2 |a s'
 * sin s| + 2 (a^2 cos(s)^2 + s'^2) tan c), which increases with c. */
static double vertex_acceleration(const Mover *mover, int64_t i, double t0, double t1) {
    Reach reach = vertex_reach(mover, i, t0, t1);
    double rate = mover->leg.rate, across_rate = 0.0, s = sin(reach.across), c = reach.cosine;
    if (mover->body->changes) {
        rate = fabs(rate + body_column(mover->scene, mover->body, FORWARD_RATE)[i]);
        across_rate = fabs(body_column(mover->scene, mover->body, STARBOARD_RATE)[i]);
    }
    double secant = 1.0 / reach.up, tangent = sqrt(most(secant * secant - 1.0, 0.0));
    double bound = rate * rate * s * c + 2.0 * rate * across_rate * s;
    bound += 2.0 * (rate * rate * c * c + across_rate * across_rate) * tangent;
    return mover->scene->plane.radius_m * secant * secant * bound;
}

Bounds circle_bounds(const Mover *mover, double t0, double t1) {
    double middle = 0.5 * (t0 + t1), away = 0.0, acceleration = 0.0;
    Vector velocity = circle_velocity(mover, middle);
    for (int64_t i = 0; i < mover->body->count; i++) {
        Vector own = vertex_velocity(mover, i, middle);
        away = most(away, hypot(own.x - velocity.x, own.y - velocity.y));
        acceleration = most(acceleration, vertex_acceleration(mover, i, t0, t1));
    }
    return (Bounds){acceleration, away + 0.5 * (t1 - t0) * acceleration};
}

Vector circle_reference(const Mover *mover, double t) {
    Vector3 v = on_leg(&mover->leg, theta_at(mover, t));
    double radius_m = mover->scene->plane.radius_m;
    return (Vector){radius_m * v.x / v.up, radius_m * v.y / v.up};
}

/* The path of the reference point during a time. phi: angles of its ends from the leg's point nearest to the centre,
 * within a quarter turn: cos(phi) = cos(C) / cos(K) with C the angle from the centre, below 60 degrees, and K that of
 * the nearest point. centre: cos(K). */
typedef struct {
    double t0, t1, phi0, phi1, centre;
} Way;

static Way way_of(const Mover *mover, double t0, double t1) {
    const CircleLeg *leg = &mover->leg;
    double at_nearest = atan2(leg->heading.up, leg->start.up);
    return (Way){t0, t1, theta_at(mover, t0) - at_nearest, theta_at(mover, t1) - at_nearest,
                 hypot(leg->start.up, leg->heading.up)};
}

/* A bound on x_uu of a vertex, in radii. The reference point is linear in u = tan(phi). With K the cosine of the
 * nearest point's angle from the centre and sigma = C.S, a vertex f ahead and s across has x_uu = cos(phi)^4 (sin s
 * J(S) + 2 (K cos s sin f - sigma sin s sin phi) / (C.V cos phi) x_phi). */
static double vertex_bend(const Mover *mover, const Reach *reach, const Way *way) {
    double nearest = way->phi0 * way->phi1 <= 0.0 ? 0.0 : least(fabs(way->phi0), fabs(way->phi1)), c = cos(nearest);
    double sine = sin(most(fabs(way->phi0), fabs(way->phi1))), s = sin(reach->across);
    double turning = way->centre * sin(reach->ahead) + fabs(mover->leg.starboard.up) * s * sine;
    return (s * c * c * c * c + 2.0 * turning * c * c * c / reach->up) * reach->cosine / (reach->up * reach->up);
}

/* A bound on the second derivative in time, in radii, of the offset of vertex i from the reference point. Subscripts
 * are partial derivatives of x(phi, f, s), with x_f = x_phi, phi' = w and u' = w sec(phi)^2; X, the reference point, is
 * linear in u. Then o'' = x_uu u'^2 + 2 w^2 tan(phi) (x_phi - X_phi) + 2 w (x_ff f' + x_fs s') + x_ff f'^2 + 2 x_fs f'
 * s' + x_ss s'^2, where |x_phi - X_phi| is at most |f| max |x_ff| + |s| max |x_fs| between X and x. As in
 * `vertex_acceleration`, in units of R sec(c)^2: |x_ff| and |x_fs| <= |sin s| + 2 tan c, and |x_ss| <= 2 tan c. */
static double offset_bend(const Mover *mover, int64_t i, const Reach *reach, const Way *way) {
    double rate = mover->leg.rate, furthest = most(fabs(way->phi0), fabs(way->phi1)), s = sin(reach->across);
    double secant = 1.0 / cos(furthest), tangent = tan(furthest);
    /* 0 for constant shape. */
    double f_rate = fabs(body_column(mover->scene, mover->body, FORWARD_RATE)[i]);
    double s_rate = fabs(body_column(mover->scene, mover->body, STARBOARD_RATE)[i]);
    double reference_up =
        least(on_leg(&mover->leg, theta_at(mover, way->t0)).up, on_leg(&mover->leg, theta_at(mover, way->t1)).up);
    /* Between the reference point and the vertex, as in `vertex_reach`. */
    double up = least(reach->up, reference_up) - sag(reach->ahead, reach->across, s), scale = 1.0 / (up * up);
    double outward = 2.0 * sqrt(most(scale - 1.0, 0.0)), mixed = scale * (s + outward);
    double bend = vertex_bend(mover, reach, way) * (rate * secant * secant) * (rate * secant * secant);
    bend += 2.0 * rate * rate * tangent * (reach->ahead + reach->across) * mixed;
    bend += (2.0 * rate * (f_rate + s_rate) + f_rate * f_rate + 2.0 * f_rate * s_rate) * mixed;
    return bend + s_rate * s_rate * scale * outward;
}

/* Bound on the difference between the fraction of the path and the fraction of the time: u = tan(phi) deviates from its
 * chord by at most max |u_tt| h^2 / 8, u_tt = 2 w^2 sec(phi)^2 tan(phi). */
static double share_deviation(const Mover *mover, const Way *way) {
    double furthest = most(fabs(way->phi0), fabs(way->phi1)), u = fabs(tan(way->phi1) - tan(way->phi0));
    double turn = mover->leg.rate * (way->t1 - way->t0) / cos(furthest);
    return u > 0.0 ? least(2.0 * turn * turn * tan(furthest) / u / 8.0, 1.0) : 0.0;
}

/* The reference point is linear in u = tan(phi), and u' = w sec(phi)^2: x'' = 2 w tan(phi) x', x''' = 2 w^2 (1 + 3
 * tan(phi)^2) x'. */
Acceleration circle_acceleration(const Mover *mover, double t0, double t1) {
    Way way = way_of(mover, t0, t1);
    double middle = 0.5 * (t0 + t1), rate = mover->leg.rate, tangent = tan(0.5 * (way.phi0 + way.phi1)), offset = 0.0;
    double furthest = tan(most(fabs(way.phi0), fabs(way.phi1))), bent = 2.0 * rate * tangent;
    Vector velocity = circle_velocity(mover, middle);
    for (int64_t i = 0; i < mover->body->count; i++) {
        Reach reach = vertex_reach(mover, i, t0, t1);
        offset = most(offset, offset_bend(mover, i, &reach, &way));
    }
    double fastest = norm(velocity) * (1.0 + furthest * furthest) / (1.0 + tangent * tangent);
    double jerk = 2.0 * rate * rate * (1.0 + 3.0 * furthest * furthest) * fastest;
    return (Acceleration){{bent * velocity.x, bent * velocity.y},
                          mover->scene->plane.radius_m * offset + 0.5 * (t1 - t0) * jerk};
}

Sweep circle_sweep(const Mover *mover, double t0, double t1, double change) {
    Way way = way_of(mover, t0, t1);
    double bend = 0.0, up = 1.0, h = t1 - t0;
    double u = sin(way.phi1 - way.phi0) / (cos(way.phi0) * cos(way.phi1));
    for (int64_t i = 0; i < mover->body->count; i++) {
        Reach reach = vertex_reach(mover, i, t0, t1);
        double own =
            mover->body->changes ? offset_bend(mover, i, &reach, &way) * h * h : vertex_bend(mover, &reach, &way) * u * u;
        bend = most(bend, own), up = least(up, reach.up);
    }
    double deviation = mover->scene->plane.radius_m * bend / 8.0;
    if (mover->body->changes) deviation += share_deviation(mover, &way) * change;
    return (Sweep){deviation, 1.0 / (up * up)};
}
