/* Contact times of one pair of moving convex polygons that are proven without a search: stage 3 is step 1, the other
 * steps are of stage 4. search.c takes the pairs that stay undecided.
 *
 * Step 1 runs without a separation, for motion within KERNEL_TOUCH_M of uniform; its answer is final. Other pairs go
 * through at most MAX_WINDOWS rounds of step 2, then through steps 3 and 4:
 *
 * 1. Closed form. For rigid polygons in uniform motion the gap along each edge normal is linear in time, so the contact
 *    is one interval. The deviation from rigid uniform motion bounds its error.
 * 2. Certified window. Along a fixed direction the gap is concave in time if vertices move along their chords. The
 *    chord of the gap, minus M h^2 / 8 for the deviation from the chords, proves separation outside a window.
 * 3. Roots. Between the window's end and an instant of contact, solve for clearance zero on the true motion; verify the
 *    sign on both sides of the root, beyond the rounding error.
 * 4. Certificate. A chord, as in step 2, proves separation from the window's end to the root. The convexity of the
 *    separation of rigid polygons in uniform motion proves contact from the root on.
 *
 * With a separation, the scale of the plane decides most pairs: farther apart than the separation at the largest scale
 * is apart, nearer than at the smallest scale is in contact. In between, in the zone, the distance on the earth
 * decides, if it is proven to change in one direction (zone.h). A pair that stays undecided is searched (search.c).
 */
#include "narrow/certain.h"

#include "geometry/roots.h"
#include "geometry/runs.h"
#include "narrow/window.h"
#include "narrow/zone.h"

/* Most rounds of window and witness: each shrinks the slack by the square of the window's shrinkage. With a separation
 * windows shrink at least LEAST_WINDOWS_APART times: the scale varies less in a short window, and the zone is narrower.
 */
enum { MAX_WINDOWS = 6, LEAST_WINDOWS_APART = 3 };
/* Nested bisections to prove that contact lasts. */
enum { MAX_HALVINGS = 12 };
/* The zone ends where the polygons are nearer than at the smallest scale by this fraction of the separation. */
static const double INTO_SHARE = 1e-3;
/* Where near misses are looked at, as shares of the way from an end to the witness. More: smaller errors, more work. The
 * first suffices for most pairs; at the end itself the pair is proven apart. */
static const double CLOSE_SHARES[] = {0x1p-10, 0x1p-5};
enum { CLOSE_LOOKS = sizeof CLOSE_SHARES / sizeof *CLOSE_SHARES };

static const Contact UNDECIDED = {IS_UNDECIDED, IS_EITHER, 0.0, 0.0, 0.0};
static const Contact SEPARATED = {IS_SEPARATED, IS_EITHER, 0.0, 0.0, 0.0};

/* Plane scales at all places of a pair during a time; and at those within reach of each other, which decide the
 * distance: no place elsewhere is within the separation and margin. */
typedef struct {
    Scales all, near;
} Reached;

/* A time of a pair: in contact at the witness, apart outside [start, end]. depth: clearance at the witness, negative;
 * touch: rounding error bound at the largest scale; plane metres. */
typedef struct {
    double low, high, start, witness, end, depth, touch;
    Reached scales;
} Window;

/* One end of the contact: between outer (apart) and inner (in contact). */
typedef struct {
    bool is_proven;
    double outer, inner;
} End;

/* Upper bound on the clearance, plane metres. */
static double depth_at(Encounter *pair, double t, double smallest) {
    if (pair->separation_m == 0.0) return encounter_gap(pair, t).gap;
    return encounter_plane_distance(pair, t).gap - pair->separation_m * smallest;
}

/* Clearance on the earth, metres. */
static double excess_at(Encounter *pair, double t) { return encounter_clearance_m(pair, t, INFINITY); }

/* Compute the polygons at both ends of a time, and the scales during it. */
static Reached reached_during(Encounter *pair, double start, double end) {
    Extent extent = encounter_extent(pair, start, end);
    Scales all = plane_scales(pair->plane, &extent);
    if (pair->separation_m == 0.0) return (Reached){all, all};
    double reach = plane_span_m(pair->plane, pair->separation_m + pair->margin_m, all.largest);
    return (Reached){all, encounter_scales_within(pair, reach)};
}

/* Upper bound on the plane metres of a distance; for a depth (negative) the bound of least magnitude. */
static double span_of(const Encounter *pair, double distance_m, Reached scales) {
    if (distance_m > 0.0) return plane_span_m(pair->plane, distance_m, scales.near.largest);
    return distance_m * scales.all.smallest;
}

/* slack: deviation of vertices from their chords, plus the rounding error bound, plane metres. */
static Levels levels_of(const Encounter *pair, double slack, Reached scales) {
    double wanted_m = pair->separation_m;
    return (Levels){slack + span_of(pair, wanted_m + pair->margin_m, scales), slack + span_of(pair, wanted_m, scales),
                    slack + span_of(pair, wanted_m - pair->deep_m, scales)};
}

/* Whether a pair with this plane gap violates the separation by more than the margin, beyond rounding. */
static bool is_deep(const Encounter *pair, double gap, Reached scales) {
    double wanted_m = pair->separation_m - pair->deep_m - KERNEL_TOUCH_M;
    return gap < wanted_m * (wanted_m > 0.0 ? scales.near.smallest : scales.all.largest);
}

/* Whether the pair is in contact all the way from p, with clearance at most -touch, to q, with clearance depth < 0.
 *
 * With K the spread of velocities and L the time between, the separation at a fraction s of it is at most (1 - s) f(p)
 * + s (f(q) + 2 K L): at most -touch if f(p) <= -touch and f(q) <= -touch - 2 K L.
 */
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

/* The gap as a function of time, for root finding. Stores the axis of the last instant at which the pair was apart. */
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

/* Seconds per metre of gap along an axis, from the velocities. */
static double pace_of(const Encounter *pair, double t, Vector axis) {
    Vector a = mover_velocity(&pair->a, t), b = mover_velocity(&pair->b, t);
    return 1.0 / (axis.x * (b.x - a.x) + axis.y * (b.y - a.y));
}

static double measured_excess(void *pair, double t) { return excess_at(pair, t); }

/* The plane distance minus a level as a function of time, for root finding. */
typedef struct {
    Encounter *pair;
    double level;
} Level;

static double measured_distance(void *of, double t) {
    Level *level = of;
    return encounter_plane_distance(level->pair, t).gap - level->level;
}

/* Whether the pair stays apart between two instants. axis: that of the gap at `outer`. Uses the chord along the axis,
 * minus the deviation of vertices from their chords. */
static bool stays_apart(Encounter *pair, double limit, double outer, Vector axis, double touch) {
    if (limit == outer) return true;
    encounter_put(pair, limit, &pair->a_now, &pair->b_now);
    double along = gap_along(axis, &pair->a_now, &pair->b_now), h = fabs(outer - limit);
    double acceleration = encounter_bounds(pair, least(limit, outer), most(limit, outer)).acceleration;
    return along - touch >= 0.5 * acceleration * h * h;
}

/* Prove the end of a touch between a window's limit and its witness. */
static End touch_end(Encounter *pair, const Window *window, double limit, bool is_all) {
    End end = {false, limit, limit};
    Gaps gaps = {.pair = pair};
    double gap = measured_gap(&gaps, limit), touch = window->touch;
    /* In contact at the limit: an end of the time itself, so only if the window reaches it. */
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

/* Prove the end of a loss of separation between a window's limit and its witness. */
static End separation_end(Encounter *pair, const Window *window, double limit, bool is_all) {
    End end = {false, limit, limit};
    double at_limit = depth_at(pair, limit, window->scales.near.smallest), touch = window->touch;
    if (is_all && at_limit < -touch) {
        end.is_proven = holds(pair, window, limit, window->witness, window->depth);
        return end;
    }
    /* The zone ends where the polygons are slightly nearer than the separation at the smallest scale. */
    double wanted = pair->separation_m * window->scales.near.smallest, into = INTO_SHARE * wanted;
    if (!(at_limit > touch) || !(window->depth + into < 0.0)) return end;
    Level level = {pair, wanted - into};
    double deepest = least(window->depth + into, -1e-9);
    Root zone = root_between(measured_distance, &level, limit, at_limit + into, window->witness, deepest, 0.5 * into, NAN);
    if (!zone.is_found) return end;
    /* Within the zone, solve for clearance zero on the earth. */
    double doubt = encounter_certainty_margin_m(pair), gap = excess_at(pair, limit), within = excess_at(pair, zone.inner);
    if (!(gap > doubt) || !(within < -doubt)) return end;
    Root root = root_between(measured_excess, pair, limit, gap, zone.inner, within, doubt, NAN);
    if (!root.is_found) return end;
    end.outer = root.outer, end.inner = root.inner;
    /* Mostly the distance is proven to change in one direction from the limit on; otherwise prove both sides of the
     * root. */
    bool is_told = zone_closes_in(pair, limit, zone.inner, window->scales.all) ||
                   (zone_is_apart(pair, limit, root.outer) && zone_is_near(pair, root.inner, zone.inner));
    end.is_proven = is_told && holds(pair, window, zone.inner, window->witness, window->depth);
    return end;
}

/* The contact of a window, or UNDECIDED. */
static Contact contact_in_window(Encounter *pair, const Window *window, Depth depth) {
    End (*end_of)(Encounter *, const Window *, double, bool) = pair->separation_m == 0.0 ? touch_end : separation_end;
    End start = end_of(pair, window, window->start, window->start <= window->low);
    if (!start.is_proven) return UNDECIDED;
    End end = end_of(pair, window, window->end, window->end >= window->high);
    if (!end.is_proven) return UNDECIDED;
    double error = most(fabs(start.inner - start.outer), fabs(end.inner - end.outer));
    return (Contact){IS_IN_CONTACT, depth, start.outer, end.outer, error};
}

/* A plane distance up to which a pair is within the margin anywhere. */
static double margin_level(const Encounter *pair, double smallest) { return (pair->separation_m + pair->margin_m) * smallest; }

/* An instant near `end` at which a pair is seen within a level, else the witness. */
static double close_from(Encounter *pair, double end, double witness, double level) {
    for (int k = 0; k < CLOSE_LOOKS; k++) {
        double at = end + CLOSE_SHARES[k] * (witness - end);
        if (encounter_plane_distance(pair, at).gap <= level) return at;
    }
    return witness;
}

/* A pair proven apart, but within the margin at the witness, and at other times only from start to end. Its error
 * comes from a few looks at either end: more would make near misses more expensive than contacts. */
static Contact close_in(Encounter *pair, double start, double end, double witness, double level) {
    double first = close_from(pair, start, witness, level), last = close_from(pair, end, witness, level);
    return (Contact){IS_CLOSE, IS_SHALLOW, start, end, most(first - start, end - last)};
}

/* The times during which gaps that are linear in time are below a level: closing gaps are below from `first` on,
 * opening gaps until `last`. */
typedef struct {
    double first, last;
} Below;

static void take_gap(Below *below, double gap, double rate, double level) {
    if (rate < 0.0) below->first = most(below->first, (level - gap) / rate);
    else if (rate > 0.0) below->last = least(below->last, (level - gap) / rate);
    else if (gap > level) below->last = -INFINITY;
}

/* An edge of a polygon, and the gap to another polygon along its normal, with its rate. */
typedef struct {
    Vector normal;
    double length, own, gap, rate;
} Edge;

/* The edge from vertex k; rate for a polygon that moves at `velocity` relative to the edge. The gap is not set. False
 * if the edge has length zero. */
static bool edge_of(const Polygon *mine, int64_t k, Vector velocity, Edge *edge) {
    int64_t m = edge_end(mine, k);
    double nx = mine->y[m] - mine->y[k], ny = mine->x[k] - mine->x[m], length = sqrt(nx * nx + ny * ny);
    if (!(length > 0.0)) return false;
    *edge = (Edge){{nx, ny}, length, own_reach(nx, ny, mine, k), 0.0, (nx * velocity.x + ny * velocity.y) / length};
    return true;
}

/* The gap along an edge's normal; and an upper bound on it that costs no search for polygons in runs. */
static double gap_of(const Edge *edge, Ahead *ahead) {
    return (ahead_along(edge->normal.x, edge->normal.y, ahead) - edge->own) / edge->length;
}

static double gap_at_most(const Edge *edge, const Ahead *ahead) {
    return (ahead_at(edge->normal.x, edge->normal.y, ahead) - edge->own) / edge->length;
}

/* The largest gap along the edge normals of `mine` at time t, extrapolated at constant rates; at least `widest`. */
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

/* The times during which all gaps along edges are below each level: possibly touching, certainly touching, possibly
 * within the margin, possibly deep. */
enum { PERHAPS, SURELY, NEAR, DEEP, LEVELS };
typedef struct {
    double level[LEVELS];
    Below below[LEVELS];
} Times;

static void take_all(Times *times, double gap, double rate) {
    for (int k = 0; k < LEVELS; k++) take_gap(&times->below[k], gap, rate, times->level[k]);
}

/* Whether an upper bound on a gap leaves all times unchanged; then the gap itself does. */
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

/* Decide whether rigid polygons in uniform motion that are apart come within the margin, at an instant of the times
 * that edge normals leave. Each round tests the middle of the remaining times, and adds the direction of the connecting
 * line there. */
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

/* Step 1: rigid polygons in uniform motion, up to a deviation (`departure`, plane metres). */
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
    /* Only if the deviation is within rounding: a larger one would widen the contact by the time it takes to close it.
     */
    if (touches && departure <= KERNEL_TOUCH_M) return closed_form(pair, low, high, departure);
    encounter_set_closed_form(pair, false);
    for (int round = 1; round <= MAX_WINDOWS; round++) {
        /* Compute both ends of the window, and the scales. */
        mover_focus(&pair->a, start, end), mover_focus(&pair->b, start, end);
        Reached scales = reached_during(pair, start, end);
        double h = end - start, touch = KERNEL_TOUCH_M * scales.all.largest;
        pair->work->windows++;
        /* Fractions of the window outside which the pair is apart, not in contact, not deep. */
        Levels levels = levels_of(pair, bounds.acceleration * h * h / 8.0 + touch, scales);
        Shares shares = window_shares(pair, levels);
        if (is_none(shares.near)) return SEPARATED;
        /* Proven for the whole round's time, so also for the shorter ones that follow. */
        is_apart = is_apart || is_none(shares.touch), is_shallow = is_shallow || is_none(shares.deep);
        /* Witness: the middle of the fraction in which it may be deepest. */
        Share likely = is_apart ? shares.near : is_shallow ? shares.touch : shares.deep;
        double witness = start + 0.5 * (likely.u + likely.v) * h;
        if (is_apart) {
            double level = margin_level(pair, scales.near.smallest);
            Gap seen = encounter_plane_distance(pair, witness);
            if (seen.gap <= level) return close_in(pair, start + shares.near.u * h, start + shares.near.v * h, witness, level);
            /* Apart at the witness: corners are farther apart than edge normals show. Try the direction of the
             * connecting line. */
            shares.near = window_share_along(pair, seen.axis, levels.near, shares.near);
            if (is_none(shares.near)) return SEPARATED;
        } else {
            /* In contact at the witness: solve for both ends, and certify. */
            Window window = {.low = low, .high = high, .touch = touch, .scales = scales};
            window.start = start + shares.touch.u * h, window.end = start + shares.touch.v * h, window.witness = witness;
            window.depth = depth_at(pair, witness, scales.near.smallest);
            if (window.depth < -2.0 * touch && (touches || round >= LEAST_WINDOWS_APART)) {
                double gap = window.depth + pair->separation_m * scales.near.smallest;
                Depth depth = is_deep(pair, gap, scales) ? IS_DEEP : is_shallow ? IS_SHALLOW : IS_EITHER;
                return contact_in_window(pair, &window, depth);
            }
        }
        /* Undecided: shrink the window and try again. */
        end = start + shares.near.v * h, start += shares.near.u * h;
    }
    return UNDECIDED;
}
