#include "planes/bend.h"

static Range range_of(double a, double b) { return (Range){least(a, b), most(a, b)}; }

static Range plus(Range a, Range b) { return (Range){a.low + b.low, a.high + b.high}; }

static Range times(Range a, Range b) {
    Range first = range_of(a.low * b.low, a.low * b.high), second = range_of(a.high * b.low, a.high * b.high);
    return (Range){least(first.low, second.low), most(first.high, second.high)};
}

static Range scaled(double factor, Range range) { return range_of(factor * range.low, factor * range.high); }

static Range squared(Range a) {
    double low = a.low * a.low, high = a.high * a.high;
    return (Range){a.low < 0.0 && a.high > 0.0 ? 0.0 : least(low, high), most(low, high)};
}

/* The second and the third derivative of psi at a rectifying latitude. */
typedef struct {
    double second, third;
} Slopes;

static Slopes slopes_at(const KernelPlane *earth, double mu) {
    double series[EARTH_TERMS];
    earth_series(earth, mu, 3, series);
    return (Slopes){2.0 * series[1], 6.0 * series[2]};
}

/* A vertex at an instant: its steps forward and to starboard, and the latitudes after both, radians. */
typedef struct {
    double forward, starboard, first, second;
} Steps;

static Steps steps_at(const Mover *mover, int64_t i, double into, double mu) {
    const RhumbLeg *leg = &mover->body->leg.rhumb;
    double forward = body_column(mover->scene, mover->body, FORWARD)[i];
    double starboard = body_column(mover->scene, mover->body, STARBOARD)[i];
    if (mover->body->changes) {
        forward += body_column(mover->scene, mover->body, FORWARD_RATE)[i] * into;
        starboard += body_column(mover->scene, mover->body, STARBOARD_RATE)[i] * into;
    }
    double first = mu + forward * leg->north;
    return (Steps){forward, starboard, first, first - starboard * leg->east};
}

/* A step h of a vertex to the east moves it by a h D, D the mean of psi' over latitudes q that change at a rate q':
 * (h D)'' is the mean of 2 h' psi'' q' + h psi''' q'^2. */
static Range step_bend(double length_rate, Range length, Range rate, Range second, Range third) {
    Range steady = times(times(length, squared(rate)), third);
    return length_rate == 0.0 ? steady : plus(steady, scaled(2.0 * length_rate, times(rate, second)));
}

/* psi'' increases with latitude, and psi''' with the distance from the equator: both are bounded by their values at the
 * southernmost and the northernmost latitude of the haven during the time, which are linear in time. */
static Range rhumb_bend(const Mover *mover, Vector along, double t0, double t1) {
    const KernelPlane *earth = &mover->scene->plane;
    const Body *body = mover->body;
    const RhumbLeg *leg = &body->leg.rhumb;
    double into[2] = {mover->into_s + t0, mover->into_s + t1}, mu[2], own = leg->delta_mu / leg->leg_s;
    for (int k = 0; k < 2; k++) mu[k] = leg->start_mu + into[k] / leg->leg_s * leg->delta_mu;
    Range reach = range_of(mu[0], mu[1]);
    for (int64_t i = 0; i < body->count; i++)
        for (int k = 0; k < 2; k++) {
            Steps steps = steps_at(mover, i, into[k], mu[k]);
            reach.low = least(reach.low, least(steps.first, steps.second));
            reach.high = most(reach.high, most(steps.first, steps.second));
        }
    Slopes south = slopes_at(earth, reach.low), north = slopes_at(earth, reach.high);
    Range second = {south.second, north.second}, third = range_of(south.third, north.third);
    if (reach.low < 0.0 && reach.high > 0.0) third.low = slopes_at(earth, 0.0).third;
    double pace = leg->rate_x / leg->leg_s * own;
    Range reference = range_of(pace * slopes_at(earth, mu[0]).second, pace * slopes_at(earth, mu[1]).second);
    Range found = {INFINITY, -INFINITY};
    for (int64_t i = 0; i < body->count; i++) {
        Steps start = steps_at(mover, i, into[0], mu[0]), end = steps_at(mover, i, into[1], mu[1]);
        double ahead = 0.0, aside = 0.0;
        if (body->changes) {
            ahead = body_column(mover->scene, body, FORWARD_RATE)[i];
            aside = body_column(mover->scene, body, STARBOARD_RATE)[i];
        }
        double middle = own + ahead * leg->north, last = middle - aside * leg->east;
        Range forward = scaled(leg->east, range_of(start.forward, end.forward));
        Range starboard = scaled(leg->north, range_of(start.starboard, end.starboard));
        Range offset = plus(step_bend(ahead * leg->east, forward, range_of(own, middle), second, third),
                            step_bend(aside * leg->north, starboard, range_of(middle, last), second, third));
        Range x = plus(reference, scaled(earth->radius_m, offset));
        Range bend = plus(scaled(along.x, x), scaled(along.y * earth->radius_m * last * last, second));
        found.low = least(found.low, bend.low), found.high = most(found.high, bend.high);
    }
    return found;
}

Range mover_bend(const Mover *mover, Vector along, double t0, double t1) {
    REQUIRE(t0 <= t1);
    if (mover->body->motion == STANDS_STILL) return (Range){0.0, 0.0};
    if (mover->body->motion == ON_RHUMB_LINE) return rhumb_bend(mover, along, t0, t1);
    double bound = norm(along) * mover_bounds(mover, t0, t1).acceleration;
    return (Range){-bound, bound};
}
