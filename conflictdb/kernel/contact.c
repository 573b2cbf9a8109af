/* The certified solver: conflictdb's method `exact`, a pair at a time.
 *
 * Of each pair, in this order and only as far as it is needed:
 *
 * 1. Closed form. Where both polygons move evenly and rigidly but for a trace, gaps along the normals of their edges are
 *    linear in time: the contact is one interval, and the trace bounds its error.
 * 2. Certified window. Along a fixed direction the gap of polygons whose vertices move along their chords is concave in
 *    time: its chord, less the bound on how far vertices leave theirs, M h^2 / 8, shows when the pair is apart.
 * 3. Ends. Between a window's end and an instant of conflict the measure is brought to zero on the true motion, and
 *    evaluated on both sides of the answer, beyond what rounding could be worth.
 * 4. Certificate. That the pair is apart from the window's end to there follows again from a chord; that it is in
 *    conflict from there on, from the convexity of the separation of rigid polygons in even motion.
 *
 * With a separation the plane decides most: what is further apart than that at the largest scale reached is apart, what
 * is nearer than at the smallest is in conflict. In the zone between, the distance on the earth decides, where the
 * polygons close in beyond doubt.
 */
#include "contact.h"

#include "roots.h"
#include "runs.h"
#include "window.h"
#include "zone.h"

/* Rounds of window and witness: each shrinks the slack by the square of how much the window shrank. With a separation
 * windows are shrunk at least three times: the scale varies less in a short one, and the zone in doubt is narrower. */
enum { MAX_WINDOWS = 6, LEAST_WINDOWS_APART = 3 };
/* Halvings that prove a conflict to hold. */
enum { MAX_HALVINGS = 12 };
/* The zone is left where the polygons are nearer than at the smallest scale by this share of the separation. */
static const double INTO_SHARE = 1e-3;

static const Contact UNDECIDED = {IS_UNDECIDED, IS_EITHER, 0.0, 0.0, 0.0};
static const Contact SEPARATED = {IS_SEPARATED, IS_EITHER, 0.0, 0.0, 0.0};

/* The scales of all places of a pair during a time, and of those that are within reach of each other where the distance
 * matters: nothing further apart than is asked about lies elsewhere. */
typedef struct {
    Scales all, near;
} Reached;

/* A time of an encounter in which it is in contact at the witness, and outside of which it is apart. depth: how much
 * too near it is at the witness, < 0; touch: what rounding is worth, at the largest scale; plane metres. */
typedef struct {
    double low, high, start, witness, end, depth, touch;
    Reached scales;
} Window;

/* One side of a window, and the proven end of the conflict there. */
typedef struct {
    bool is_proven;
    double outer, inner;
} End;

/* A bound from above on how much further apart than wanted the pair is, plane metres. */
static double depth_at(Encounter *pair, double t, double smallest) {
    if (pair->separation_m == 0.0) return encounter_gap(pair, t).gap;
    return encounter_plane_distance(pair, t).gap - pair->separation_m * smallest;
}

/* How much further apart than wanted the pair is, metres on the earth. */
static double excess_at(Encounter *pair, double t) { return encounter_clearance_m(pair, t, INFINITY); }

/* Put the polygons where they are at both ends of a time, and tell the scales. */
static Reached reached_during(Encounter *pair, double start, double end) {
    Extent extent = encounter_extent(pair, start, end);
    Scales all = plane_scales(pair->plane, &extent);
    if (pair->separation_m == 0.0) return (Reached){all, all};
    double reach = plane_span_m(pair->plane, pair->separation_m + pair->margin_m, all.largest);
    return (Reached){all, encounter_scales_within(pair, reach)};
}

/* How many plane metres a distance may take up, or a depth (< 0) takes up at least. */
static double span_of(const Encounter *pair, double distance_m, Reached scales) {
    if (distance_m > 0.0) return plane_span_m(pair->plane, distance_m, scales.near.largest);
    return distance_m * scales.all.smallest;
}

/* slack: how far vertices leave their chords, and what rounding is worth, plane metres. */
static Levels levels_of(const Encounter *pair, double slack, Reached scales) {
    double wanted_m = pair->separation_m;
    return (Levels){slack + span_of(pair, wanted_m + pair->margin_m, scales), slack + span_of(pair, wanted_m, scales),
                    slack + span_of(pair, wanted_m - pair->deep_m, scales)};
}

/* Whether a pair with this gap in the plane is deeper in contact than the margin, beyond doubt. */
static bool is_deep(const Encounter *pair, double gap, Reached scales) {
    double wanted_m = pair->separation_m - pair->deep_m - KERNEL_TOUCH_M;
    return gap < wanted_m * (wanted_m > 0.0 ? scales.near.smallest : scales.all.largest);
}

/* Whether the pair is in conflict all the way from p, by `touch` or more, to q, by `depth` (< 0).
 *
 * With K the spread of velocities and L the time between, the separation at a share s of it is at most
 * (1 - s) f(p) + s (f(q) + 2 K L): no more than -touch where f(p) <= -touch and f(q) <= -touch - 2 K L. */
static bool holds(Encounter *pair, const Window *window, double p, double q, double depth) {
    struct {
        double p, q, fp, fq;
        int halvings;
    } stack[MAX_HALVINGS + 1], part;
    double touch = window->touch;
    int top = 0;
    stack[top].p = p, stack[top].q = q, stack[top].fp = -touch, stack[top].fq = depth, stack[top++].halvings = 0;
    while (top > 0) {
        part = stack[--top];
        double first = least(part.p, part.q), last = most(part.p, part.q);
        double way = 2.0 * encounter_bounds(pair, first, last).spread * (last - first), limit = -touch - way;
        if (part.fp <= limit || part.fq <= limit || most(part.fp, part.fq) <= -touch - 0.5 * way) continue;
        if (part.halvings + 1 >= MAX_HALVINGS) return false;
        double middle = 0.5 * (part.p + part.q), f = depth_at(pair, middle, window->scales.near.smallest);
        if (!(f <= -touch)) return false;
        int halvings = part.halvings + 1;
        stack[top].p = part.p, stack[top].q = middle, stack[top].fp = part.fp, stack[top].fq = f;
        stack[top++].halvings = halvings;
        stack[top].p = middle, stack[top].q = part.q, stack[top].fp = f, stack[top].fq = part.fq;
        stack[top++].halvings = halvings;
    }
    return true;
}

/* The gap as a measure, which remembers its axis when the pair was last apart. */
typedef struct {
    Encounter *pair;
    double apart_at;
    Vector axis;
} Gaps;

static double measured_gap(void *of, double t) {
    Gaps *gaps = of;
    Gap found = encounter_gap(gaps->pair, t);
    if (found.gap > 0.0) gaps->apart_at = t, gaps->axis = found.axis;
    return found.gap;
}

/* How much later a metre more is between them, by their velocities. */
static double pace_of(const Encounter *pair, double t, Vector axis) {
    Vector a = mover_velocity(&pair->a, t), b = mover_velocity(&pair->b, t);
    return 1.0 / (axis.x * (b.x - a.x) + axis.y * (b.y - a.y));
}

static double measured_excess(void *pair, double t) { return excess_at(pair, t); }

/* The plane distance less a level, as a measure. */
typedef struct {
    Encounter *pair;
    double level;
} Level;

static double measured_distance(void *of, double t) {
    Level *level = of;
    return encounter_plane_distance(level->pair, t).gap - level->level;
}

/* Whether the pair stays apart between two instants, at the second of which the gap has this axis: the chord along it,
 * less how far vertices leave theirs. */
static bool stays_apart(Encounter *pair, double limit, double outer, Vector axis, double touch) {
    if (limit == outer) return true;
    encounter_put(pair, limit, &pair->a_now, &pair->b_now);
    double along = gap_along(axis, &pair->a_now, &pair->b_now), h = fabs(outer - limit);
    double acceleration = encounter_bounds(pair, least(limit, outer), most(limit, outer)).acceleration;
    return along - touch >= 0.5 * acceleration * h * h;
}

/* The end of a touch between a window's limit and its middle. */
static End touch_end(Encounter *pair, const Window *window, double limit, bool is_all) {
    End end = {false, limit, limit};
    Gaps gaps = {.pair = pair};
    double gap = measured_gap(&gaps, limit), touch = window->touch;
    /* In touch since before the window, or until after it: only where the window is all there is. */
    if (is_all && gap < -touch) {
        end.is_proven = holds(pair, window, limit, window->witness, window->depth);
        return end;
    }
    if (!(gap > touch)) return end;
    double pace = pace_of(pair, limit, gaps.axis);
    Root root = root_between(measured_gap, &gaps, limit, gap, window->witness, window->depth, touch, pace);
    if (!root.is_found) return end;
    end.outer = root.outer, end.inner = root.inner;
    if (gaps.apart_at != root.outer) measured_gap(&gaps, root.outer);
    end.is_proven = stays_apart(pair, limit, root.outer, gaps.axis, touch) &&
                    holds(pair, window, root.inner, window->witness, window->depth);
    return end;
}

/* The end of a loss of separation between a window's limit and its middle. */
static End separation_end(Encounter *pair, const Window *window, double limit, bool is_all) {
    End end = {false, limit, limit};
    double at_limit = depth_at(pair, limit, window->scales.near.smallest), touch = window->touch;
    if (is_all && at_limit < -touch) {
        end.is_proven = holds(pair, window, limit, window->witness, window->depth);
        return end;
    }
    /* The zone ends where the polygons are just nearer than the separation at the smallest scale. */
    double wanted = pair->separation_m * window->scales.near.smallest, into = INTO_SHARE * wanted;
    if (!(at_limit > touch) || !(window->depth + into < 0.0)) return end;
    Level level = {pair, wanted - into};
    double deepest = least(window->depth + into, -1e-9);
    Root zone = root_between(measured_distance, &level, limit, at_limit + into, window->witness, deepest, 0.5 * into, NAN);
    if (!zone.is_found) return end;
    /* In the zone the distance on the earth is brought to what is wanted. */
    double doubt = encounter_certainty_margin_m(pair), gap = excess_at(pair, limit), within = excess_at(pair, zone.inner);
    if (!(gap > doubt) || !(within < -doubt)) return end;
    Root root = root_between(measured_excess, pair, limit, gap, zone.inner, within, doubt, NAN);
    if (!root.is_found) return end;
    end.outer = root.outer, end.inner = root.inner;
    /* Mostly the distance changes one way only from the limit on; else it is proven on either side of the end. */
    bool is_told = zone_closes_in(pair, limit, zone.inner, window->scales.all) ||
                   (zone_is_apart(pair, limit, root.outer) && zone_is_near(pair, root.inner, zone.inner));
    end.is_proven = is_told && holds(pair, window, zone.inner, window->witness, window->depth);
    return end;
}

/* The contact of a window, if it can be told. */
static Contact contact_in_window(Encounter *pair, const Window *window, Depth depth) {
    End (*end_of)(Encounter *, const Window *, double, bool) = pair->separation_m == 0.0 ? touch_end : separation_end;
    End start = end_of(pair, window, window->start, window->start <= window->low);
    if (!start.is_proven) return UNDECIDED;
    End end = end_of(pair, window, window->end, window->end >= window->high);
    if (!end.is_proven) return UNDECIDED;
    double error = most(fabs(start.inner - start.outer), fabs(end.inner - end.outer));
    return (Contact){IS_IN_CONTACT, depth, start.outer, end.outer, error};
}

/* The plane distance up to which a pair is within the margin, wherever it is. */
static double margin_level(const Encounter *pair, double smallest) {
    return (pair->separation_m + pair->margin_m) * smallest;
}

/* A pair that is apart, and within the margin at the witness; at other times only from start to end. How long it is so
 * beyond doubt is told by a look at either end: a closer one would make what is only close dearer than what meets. */
static Contact close_in(Encounter *pair, double start, double end, double witness, double level) {
    double first = encounter_plane_distance(pair, start).gap <= level ? start : witness;
    double last = encounter_plane_distance(pair, end).gap <= level ? end : witness;
    return (Contact){IS_CLOSE, IS_SHALLOW, start, end, most(first - start, end - last)};
}

/* The times in which gaps that are linear in time are below a level: those that close have closed by `first`, those
 * that open have not opened before `last`. */
typedef struct {
    double first, last;
} Below;

static void take_gap(Below *below, double gap, double rate, double level) {
    if (rate < 0.0) below->first = most(below->first, (level - gap) / rate);
    else if (rate > 0.0) below->last = least(below->last, (level - gap) / rate);
    else if (gap > level) below->last = -INFINITY;
}

/* An edge of a polygon, another that moves at `velocity` against it, and the gap along the edge's normal. */
typedef struct {
    Vector normal;
    double length, own, gap, rate;
} Edge;

/* The edge from vertex k, the gap not yet found; false if there is none. */
static bool edge_of(const Polygon *mine, int64_t k, Vector velocity, Edge *edge) {
    int64_t m = edge_end(mine, k);
    double nx = mine->y[m] - mine->y[k], ny = mine->x[k] - mine->x[m], length = sqrt(nx * nx + ny * ny);
    if (!(length > 0.0)) return false;
    *edge = (Edge){{nx, ny}, length, own_reach(nx, ny, mine, k), 0.0, (nx * velocity.x + ny * velocity.y) / length};
    return true;
}

/* The gap, and what it is at most, which takes no time for polygons in runs. */
static double gap_of(const Edge *edge, Ahead *ahead) {
    return (ahead_along(edge->normal.x, edge->normal.y, ahead) - edge->own) / edge->length;
}

static double gap_at_most(const Edge *edge, const Ahead *ahead) {
    return (ahead_at(edge->normal.x, edge->normal.y, ahead) - edge->own) / edge->length;
}

/* The deepest that all gaps along the edges of `mine` are at an instant, if they go on at their rates. */
static double widest_then(const Polygon *mine, const Polygon *other, Vector v, double t, double widest) {
    Ahead ahead = ahead_of(mine, other);
    Edge edge;
    for (int64_t step = ahead.step; step > 0; step = finer(step))
        for (int64_t k = 0; k < mine->count; k += step) {
            if (!edge_of(mine, k, v, &edge)) continue;
            if (ahead.is_in_runs && gap_at_most(&edge, &ahead) + edge.rate * t <= widest) continue;
            widest = most(widest, gap_of(&edge, &ahead) + edge.rate * t);
        }
    return widest;
}

/* The times in which all gaps along edges are below each of some levels: those in which a pair is perhaps and surely in
 * touch, near, and deep. */
enum { PERHAPS, SURELY, NEAR, DEEP, LEVELS };
typedef struct {
    double level[LEVELS];
    Below below[LEVELS];
} Times;

static void take_all(Times *times, double gap, double rate) {
    for (int k = 0; k < LEVELS; k++) take_gap(&times->below[k], gap, rate, times->level[k]);
}

/* Whether a gap that is no narrower than the true one leaves the times as they are: then that does. */
static bool are_times_kept(const Times *times, double gap, double rate) {
    for (int k = 0; k < LEVELS; k++) {
        Below below = times->below[k];
        take_gap(&below, gap, rate, times->level[k]);
        if (!(below.first == times->below[k].first && below.last == times->below[k].last)) return false;
    }
    return true;
}

static void take_edges(Times *times, const Polygon *mine, const Polygon *other, Vector v) {
    Ahead ahead = ahead_of(mine, other);
    Edge edge;
    for (int64_t step = ahead.step; step > 0; step = finer(step))
        for (int64_t k = 0; k < mine->count; k += step) {
            if (!edge_of(mine, k, v, &edge)) continue;
            if (ahead.is_in_runs && are_times_kept(times, gap_at_most(&edge, &ahead), edge.rate)) continue;
            take_all(times, gap_of(&edge, &ahead), edge.rate);
        }
}

/* Whether rigid polygons in even motion that are apart are within the margin, at some instant of the times in which their
 * edges say that they may be, from the middle on: where they are not, the way between them is one more direction. */
static Contact closeness(Encounter *pair, double middle, Below near, double away, double smallest, Vector of_b) {
    double level = margin_level(pair, smallest);
    for (int round = 1; round <= MAX_WINDOWS; round++) {
        double after = 0.5 * (near.first + near.last);
        Gap seen = encounter_plane_distance(pair, middle + after);
        if (seen.gap <= level) return close_in(pair, middle + near.first, middle + near.last, middle + after, level);
        double rate = seen.axis.x * of_b.x + seen.axis.y * of_b.y;
        take_gap(&near, gap_along(seen.axis, &pair->a_now, &pair->b_now) - rate * after, rate, away);
        if (near.first > near.last) return SEPARATED;
    }
    return UNDECIDED;
}

/* Rigid polygons in even motion but for a departure, plane metres. */
static Contact closed_form(Encounter *pair, double low, double high, double departure) {
    encounter_set_closed_form(pair, true);
    double middle = 0.5 * (low + high);
    Extent extent = extent_none();
    encounter_place(pair, middle);
    extent_add(&extent, &pair->a_now, pair->a.origin), extent_add(&extent, &pair->b_now, pair->a.origin);
    Scales all = plane_scales(pair->plane, &extent);
    Reached scales = {all, all};
    double slack = departure + KERNEL_TOUCH_M * all.largest;
    Levels levels = levels_of(pair, slack, scales);
    Vector va = mover_velocity(&pair->a, middle), vb = mover_velocity(&pair->b, middle);
    Vector of_a = {va.x - vb.x, va.y - vb.y}, of_b = {vb.x - va.x, vb.y - va.y};
    Below all_time = {low - middle, high - middle};
    Times times = {{slack, -slack, levels.near, levels.deep}, {all_time, all_time, all_time, all_time}};
    take_edges(&times, &pair->a_now, &pair->b_now, of_b);
    take_edges(&times, &pair->b_now, &pair->a_now, of_a);
    Below perhaps = times.below[PERHAPS], surely = times.below[SURELY], near = times.below[NEAR], deep = times.below[DEEP];
    if (near.first > near.last) return SEPARATED;
    if (perhaps.first > perhaps.last) return closeness(pair, middle, near, levels.near, all.smallest, of_b);
    if (!(surely.first < surely.last)) return UNDECIDED;
    bool is_shallow = deep.first > deep.last;
    double at = is_shallow ? 0.5 * (surely.first + surely.last) : 0.5 * (deep.first + deep.last);
    double deepest = widest_then(&pair->a_now, &pair->b_now, of_b, at, -INFINITY);
    deepest = widest_then(&pair->b_now, &pair->a_now, of_a, at, deepest);
    /* Polygons without any edge have no depth. */
    if (deepest == -INFINITY) return UNDECIDED;
    Depth depth = is_deep(pair, deepest + departure, scales) ? IS_DEEP : is_shallow ? IS_SHALLOW : IS_EITHER;
    double error = most(surely.first - perhaps.first, perhaps.last - surely.last);
    return (Contact){IS_IN_CONTACT, depth, middle + perhaps.first, middle + perhaps.last, error};
}

Contact certain_contact(Encounter *pair, double low, double high) {
    bool touches = pair->separation_m == 0.0, is_apart = false, is_shallow = false;
    if (!(high > low) || (pair->a.body->count < 3 && pair->b.body->count < 3)) return UNDECIDED;
    Bounds bounds = encounter_bounds(pair, low, high);
    double departure = 0.5 * bounds.spread * (high - low), start = low, end = high;
    /* No more than rounding: a wider one would widen every end, by what it takes the pair to close it. */
    if (touches && departure <= KERNEL_TOUCH_M) return closed_form(pair, low, high, departure);
    encounter_set_closed_form(pair, false);
    for (int round = 1; round <= MAX_WINDOWS; round++) {
        mover_focus(&pair->a, start, end), mover_focus(&pair->b, start, end);
        Reached scales = reached_during(pair, start, end);
        double h = end - start, touch = KERNEL_TOUCH_M * scales.all.largest;
        pair->work->windows++;
        Levels levels = levels_of(pair, bounds.acceleration * h * h / 8.0 + touch, scales);
        Shares shares = window_shares(pair, levels);
        if (is_none(shares.near)) return SEPARATED;
        /* What is proven of a time holds in the shorter ones that follow. */
        is_apart = is_apart || is_none(shares.touch), is_shallow = is_shallow || is_none(shares.deep);
        Share likely = is_apart ? shares.near : is_shallow ? shares.touch : shares.deep;
        double witness = start + 0.5 * (likely.u + likely.v) * h;
        if (is_apart) {
            double level = margin_level(pair, scales.near.smallest);
            Gap seen = encounter_plane_distance(pair, witness);
            if (seen.gap <= level)
                return close_in(pair, start + shares.near.u * h, start + shares.near.v * h, witness, level);
            /* Corners are further apart than edges show. */
            shares.near = window_share_along(pair, seen.axis, levels.near, shares.near);
            if (is_none(shares.near)) return SEPARATED;
        } else {
            Window window = {.low = low, .high = high, .touch = touch, .scales = scales};
            window.start = start + shares.touch.u * h, window.end = start + shares.touch.v * h, window.witness = witness;
            window.depth = depth_at(pair, witness, scales.near.smallest);
            if (window.depth < -2.0 * touch && (touches || round >= LEAST_WINDOWS_APART)) {
                double gap = window.depth + pair->separation_m * scales.near.smallest;
                Depth depth = is_deep(pair, gap, scales) ? IS_DEEP : is_shallow ? IS_SHALLOW : IS_EITHER;
                return contact_in_window(pair, &window, depth);
            }
        }
        end = start + shares.near.v * h, start += shares.near.u * h;
    }
    return UNDECIDED;
}
