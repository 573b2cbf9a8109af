/* Which differences of departure, or factors of time, bring two pieces into contact, with proofs.
 *
 * Piece a is at A(u) at its own time u, piece b at B(v). The contact set
 *
 *     C = {(u, v) in [u0, u1] x [v0, v1] : A(u) and B(v) come within reach of each other}
 *
 * does not depend on departures: a track that departs d later is at A(t - d) at t, so it meets b if and only if d = v - u
 * for some (u, v) in C (coordination space: P. A. O'Donnell, T. Lozano-Perez, ICRA 1989, doi:10.1109/ROBOT.1989.100035;
 * S. M. LaValle, "Planning Algorithms" (2006), 7.2). If all its times since its departure, the zero of u and v, take k times
 * as long, it is at A(t / k): they meet if and only if k = v / u for some (u, v) in C (goal.h). What follows says
 * "difference" for both goals: both are largest at a corner of a convex part.
 *
 * Proof from outside. Along a fixed unit vector n the gap is g(u, v) = min n.B(v) - max n.A(u). If vertices moved on their
 * chords, the minimum would be concave in v, and the maximum convex in u. They leave them by at most M h^2 / 8. So g is at
 * least a function that is affine in (u, v): each vector cuts a half-plane off the box, and v - u is largest at a corner
 * of the convex part that is left. With a reach the vertices bring their halves of it (plane_half_m).
 *
 * Two cuts end what takes long with these: across the relative velocity, where a vertex passes a vertex at the reach
 * (cuts_by_passing); and by a part of a side, within which halves differ less (cuts_by_near_part).
 *
 * The box shrinks to the part beyond the largest difference seen in contact. The slack decreases with the square of the
 * box. A box that does not shrink is halved, the one with the largest bound first.
 *
 * Proof from inside. If contact lasts on a way between two points of C (shift.c), each difference between theirs is one of
 * contact.
 */
#include <stdlib.h>

#include "scene/border.h"
#include "narrow/cuts.h"
#include "narrow/differences.h"

/* Work budget of a pair. Boxes inspected: MOST_LOOKS, or fewer for pairs of more than FEW_VERTICES, at least LEAST_LOOKS: ten
 * seconds for a million vertices. Positions computed to prove contact, by look. Boxes kept. Smaller: ends are looser. */
enum { MOST_LOOKS = 800, FEW_VERTICES = 64, LEAST_LOOKS = 24, PLACES_PER_LOOK = 16, BOXES = 96 };
/* Steps to the border between a contact and a point that is none. Fewer: less is proven from inside. */
enum { ROOT_STEPS = 40 };
/* Boxes that hardly lower their bound although smaller ones would not help. */
enum { MOST_STALLS = 24 };
/* If more than LOOSE_S remains open between the outer and the inner interval, the times are halved. */
static const double LOOSE_S = 1.0;
/* Ends are found to AIM_S; boxes are not halved below SHORTEST_S. Below KNOWN_SHARE of what distances leave open the bend
 * of motion does not matter, and nearer than FEW times that to the border no more is known. A box shrinks if to SHRUNK of
 * its size, or if its bound comes nearer to what was seen by GAIN. Waypoints of a stretched track, rounded to microseconds, and
 * times between them are off by less than ROUNDED_S. */
static const double AIM_S = 5e-7, ROUNDED_S = 1e-6, SHORTEST_S = 1e-7, KNOWN_SHARE = 0.1, FEW = 4.0, SHRUNK = 0.6, GAIN = 0.1;
/* Clearances below this are contact, beyond what a detection rounds by, metres. */
static const double SURE_M = -2.0 * KERNEL_TOUCH_M;
/* The root is near enough if it is this deep in contact, metres, or this near, seconds. */
static const double ROOT_M = 1e-7, ROOT_S = 1e-9;
/* Corners of a part are rounded by less than this share. */
static const double CORNER_SHARE = 1e-12;

/* The largest value that was seen in contact, and where; -INFINITY for none. */
typedef struct {
    double value;
    Times at;
} Seen;

typedef struct {
    Cuts cuts;
    Box *boxes;
    int looks_left, stalls;
    double aim;
} Search;

/* Keep what is larger than the value seen. */
static void cut_seen(const Search *search, Box *box, double sign, const Seen *seen) {
    if (isfinite(seen->value)) goal_cut(&search->cuts.shift.goal, &box->part, sign, seen->value);
}

/* Shrink a box to its part. */
static void fit(Box *box) {
    double u0 = INFINITY, u1 = -INFINITY, v0 = INFINITY, v1 = -INFINITY;
    for (int i = 0; i < box->part.count; i++) {
        u0 = least(u0, box->part.corner[i].u), u1 = most(u1, box->part.corner[i].u);
        v0 = least(v0, box->part.corner[i].v), v1 = most(v1, box->part.corner[i].v);
    }
    double du = CORNER_SHARE * most(fabs(u0), fabs(u1)), dv = CORNER_SHARE * most(fabs(v0), fabs(v1));
    box->u0 = most(box->u0, u0 - du), box->u1 = least(box->u1, u1 + du);
    box->v0 = most(box->v0, v0 - dv), box->v1 = least(box->v1, v1 + dv);
}

/* Whether a point is within the box of the whole pair, and asked about. */
static bool is_asked(const Shift *shift, Times at) {
    bool is_in = at.u >= shift->u0 && at.u <= shift->u1 && at.v >= shift->v0 && at.v <= shift->v1;
    return is_in && goal_is_asked(&shift->goal, at);
}

static bool is_within(const Box *box, Times at) {
    return at.u >= box->u0 && at.u <= box->u1 && at.v >= box->v0 && at.v <= box->v1;
}

static void see(const Search *search, Seen *seen, double sign, Times at) {
    double value = goal_value(&search->cuts.shift.goal, sign, at);
    if (value > seen->value) *seen = (Seen){value, at};
}

/* The last contact on the way from a contact `in` to the tip of a part, which is none, by false position (Illinois: M.
 * Dowell, P. Jarratt, BIT 11 (1971), doi:10.1007/BF01934364). It is near enough if the box would not shrink much more. */
static Times border_point(Search *search, double sign, Times in, double f_in, Times tip, double f_tip) {
    double low = 0.0, high = 1.0, f_low = f_in - SURE_M, f_high = f_tip - SURE_M;
    double length = fabs(tip.u - in.u) + fabs(tip.v - in.v);
    const Goal *goal = &search->cuts.shift.goal;
    bool is_rising = goal_value(goal, sign, tip) > goal_value(goal, sign, in);
    int side = 0;
    for (int k = 0; k < ROOT_STEPS && (high - low) * length > ROOT_S; k++) {
        if (is_rising && high - low <= GAIN * (1.0 - high)) break;
        double s = low + (high - low) * (f_low / (f_low - f_high));
        if (!(s > low && s < high) || k % 8 == 7) s = 0.5 * (low + high);
        Times at = {in.u + s * (tip.u - in.u), in.v + s * (tip.v - in.v)};
        double f = shift_clearance_m(&search->cuts.shift, at, NULL) - SURE_M;
        if (f <= 0.0) {
            low = s, f_low = f;
            if (side == -1) f_high *= 0.5;
            side = -1;
            if (f > -ROOT_M) break;
        } else {
            high = s, f_high = f;
            if (side == 1) f_low *= 0.5;
            side = 1;
        }
    }
    return (Times){in.u + low * (tip.u - in.u), in.v + low * (tip.v - in.v)};
}

/* Move a tip that is apart to where the vertices pass, at the same difference, if that is in the box; and raise the value
 * seen there or close by. False if nothing is seen. */
static bool see_passing(Search *search, const Box *box, const Passing *passing, double sign, Times *tip, double *at_tip,
                        Nearest *nearest, Seen *seen) {
    double speed = passing->b - passing->a, x = nearest->to.x - nearest->from.x, y = nearest->to.y - nearest->from.y;
    double later = -(x * passing->along.x + y * passing->along.y) / speed;
    Times abeam = {tip->u + later, tip->v + later}, at = *tip;
    if (is_within(box, abeam)) *tip = at = abeam, *at_tip = shift_clearance_m(&search->cuts.shift, abeam, nearest);
    double apart = *at_tip - SURE_M, scale = nearest->gap / (*at_tip + search->cuts.shift.reach_m), step = 0.0;
    for (int k = 0; k < 2 && apart > 0.0; k++) {
        step += (1.0 + GAIN) * apart * scale / passing->rate;
        at = (Times){tip->u + sign * step * passing->b / speed, tip->v + sign * step * passing->a / speed};
        if (!is_asked(&search->cuts.shift, at)) return false;
        apart = shift_clearance_m(&search->cuts.shift, at, NULL) - SURE_M;
    }
    if (apart <= 0.0) see(search, seen, sign, at);
    return apart <= 0.0;
}

/* What becomes of a box that was inspected. */
typedef enum { IS_DONE, IS_SMALLER, IS_HALVED } Next;

/* Raise the value seen, and cut along one more axis. at_tip, nearest: of the tip; change if the tip moves. */
static void see_more(Search *search, Box *box, Slack slack, const Passing *passing, double sign, Times middle, Times tip,
                     double *at_tip, Nearest *nearest, Seen *seen) {
    bool passes = passing->bound - box->bound <= GAIN * (passing->bound - seen->value);
    if (passes && see_passing(search, box, passing, sign, &tip, at_tip, nearest, seen)) {
        cuts_by_axis(&search->cuts, box, slack, nearest->axis);
        return;
    }
    Nearest there;
    double at_middle = shift_clearance_m(&search->cuts.shift, middle, &there);
    bool is_last = passing->rate > 0.0 && *at_tip <= FEW * slack.unknown;
    if (at_middle <= SURE_M) see(search, seen, sign, border_point(search, sign, middle, at_middle, tip, *at_tip));
    else if (!is_last || !see_passing(search, box, passing, sign, &tip, at_tip, nearest, seen))
        cuts_by_axis(&search->cuts, box, slack, there.axis);
}

/* Lower the bound of a box, and raise the value seen. IS_HALVED: by u or by v, as `by_u` says. */
static Next look(Search *search, Box *box, double sign, Seen *seen, bool *by_u) {
    Times tip;
    Nearest nearest;
    search->looks_left--, search->cuts.shift.pair->work->windows++;
    cut_seen(search, box, sign, seen);
    if (box->part.count > 0) fit(box);
    Slack slack = cuts_put_ends(&search->cuts, box);
    Passing passing = cuts_by_passing(&search->cuts, box, slack, sign);
    cuts_by_all(&search->cuts, box, slack);
    box->bound = goal_highest(&search->cuts.shift.goal, &box->part, sign, &tip);
    if (box->bound <= seen->value + search->aim) return IS_DONE;
    double before = box->bound, at_tip = shift_clearance_m(&search->cuts.shift, tip, &nearest);
    if (at_tip <= SURE_M) {
        see(search, seen, sign, tip);
        return IS_DONE;
    }
    Times middle = part_middle(&box->part);
    cuts_by_axis(&search->cuts, box, slack, nearest.axis);
    cuts_by_near_part(&search->cuts, box, slack, sign, at_tip, &nearest);
    see_more(search, box, slack, &passing, sign, middle, tip, &at_tip, &nearest, seen);
    cut_seen(search, box, sign, seen);
    box->bound = goal_highest(&search->cuts.shift.goal, &box->part, sign, &tip);
    if (box->part.count == 0) return IS_DONE;
    double hu = box->u1 - box->u0, hv = box->v1 - box->v0;
    fit(box);
    double nu = box->u1 - box->u0, nv = box->v1 - box->v0;
    bool is_bent = slack.bend_a + slack.bend_b > KNOWN_SHARE * slack.unknown;
    bool is_lower = before - box->bound > GAIN * (before - seen->value);
    search->stalls += !is_bent && !is_lower;
    if (nu <= SHORTEST_S && nv <= SHORTEST_S) return IS_DONE;
    if (!is_bent && (at_tip <= FEW * slack.unknown || search->stalls > MOST_STALLS)) return IS_DONE;
    if ((nu <= SHRUNK * hu + SHORTEST_S && nv <= SHRUNK * hv + SHORTEST_S) || (is_lower && !is_bent)) return IS_SMALLER;
    /* Halve the time during which vertices leave their chords more. */
    double of_u = hu > 0.0 ? slack.bend_a * nu * nu / (hu * hu) : 0.0,
           of_v = hv > 0.0 ? slack.bend_b * nv * nv / (hv * hv) : 0.0;
    *by_u = of_u == of_v ? nu >= nv : of_u > of_v;
    return IS_HALVED;
}

static Box half_of(const Goal *goal, const Box *box, double sign, bool by_u, bool is_first) {
    Box half = *box;
    Times at;
    double middle = by_u ? 0.5 * (box->u0 + box->u1) : 0.5 * (box->v0 + box->v1), side = is_first ? 1.0 : -1.0;
    part_cut(&half.part, by_u ? side : 0.0, by_u ? 0.0 : side, -side * middle);
    if (is_first) *(by_u ? &half.u1 : &half.v1) = middle;
    else *(by_u ? &half.u0 : &half.v0) = middle;
    half.bound = goal_highest(goal, &half.part, sign, &at);
    return half;
}

/* The largest sign times the goal in contact within a box is at most the result; -INFINITY: there is no contact. */
static double highest(Search *search, const Box *whole, double sign, Seen *seen) {
    Box *boxes = search->boxes;
    Times at;
    bool by_u = false;
    double found = -INFINITY;
    int count = 1;
    search->stalls = 0;
    boxes[0] = *whole, boxes[0].bound = goal_highest(&search->cuts.shift.goal, &whole->part, sign, &at);
    while (count > 0) {
        int next = 0;
        for (int k = 1; k < count; k++)
            if (boxes[k].bound > boxes[next].bound) next = k;
        Box box = boxes[next];
        boxes[next] = boxes[--count];
        bool is_enough = box.bound <= seen->value + search->aim || search->looks_left <= 0 || count + 2 > BOXES;
        Next then = is_enough ? IS_DONE : look(search, &box, sign, seen, &by_u);
        if (then == IS_DONE) found = most(found, box.bound);
        else if (then == IS_SMALLER) boxes[count++] = box;
        else {
            for (int k = 0; k < 2; k++) {
                boxes[count] = half_of(&search->cuts.shift.goal, &box, sign, by_u, k == 0);
                count += boxes[count].part.count > 0;
            }
        }
    }
    return most(found, seen->value);
}

static KernelDifference outer_alone(double low, double high, KernelDifferenceState state) {
    return (KernelDifference){
        .outer_low = low, .inner_low = INFINITY, .inner_high = -INFINITY, .outer_high = high, .state = (int32_t)state};
}

static KernelDifference apart(void) { return outer_alone(INFINITY, -INFINITY, KERNEL_DIFFERENCE_NONE); }

/* The differences of a pair that is set up, within its box. */
static KernelDifference differences_of(Search *search, Box *whole) {
    Encounter *pair = search->cuts.shift.pair;
    if (whole->part.count == 0) return apart();
    mover_focus(&pair->a, whole->u0, whole->u1), mover_focus(&pair->b, whole->v0, whole->v1);
    cuts_by_all(&search->cuts, whole, cuts_put_ends(&search->cuts, whole));
    if (whole->part.count == 0) return apart();
    Seen last = {-INFINITY, {0.0, 0.0}}, first = last;
    int half = search->looks_left / 2;
    search->looks_left -= half;
    double high = highest(search, whole, 1.0, &last);
    if (high == -INFINITY) return apart();
    search->looks_left += half;
    if (isfinite(last.value)) see(search, &first, -1.0, last.at);
    double low = highest(search, whole, -1.0, &first);
    if (low == -INFINITY) return apart();
    KernelDifference found = outer_alone(-low, high, KERNEL_DIFFERENCE_OUTER);
    if (isfinite(last.value) && shift_contact_lasts(&search->cuts.shift, &first.at, &last.at, part_middle(&whole->part))) {
        const Goal *goal = &search->cuts.shift.goal;
        double begins = -goal_exactly(goal, -1.0, first.at), ends = goal_exactly(goal, 1.0, last.at);
        if (begins <= ends) {
            found.state = KERNEL_DIFFERENCE_INNER, found.inner_low = begins, found.inner_high = ends;
            found.low_a_s = first.at.u, found.low_b_s = first.at.v, found.high_a_s = last.at.u, found.high_b_s = last.at.v;
        }
    }
    return found;
}

struct Differences {
    Search search;
    Encounter pair;
    const KernelScene *scene;
    double *memory, *halves;
};

/* Set up a pair; false if its times or one of its pieces is invalid. */
static bool begin(Differences *made, const Shifted *one, Box *whole) {
    Search *search = &made->search;
    Encounter *pair = &made->pair;
    double u0 = one->a_start_s, u1 = one->a_end_s, v0 = one->b_start_s, v1 = one->b_end_s;
    Vector origin = made->scene->bodies[one->a].origin;
    Goal goal = {one->is_factor, one->least, one->most, ROUNDED_S, one->weight};
    if (!(u0 <= u1 && v0 <= v1 && goal.weight > 0.0 && goal.weight < INFINITY)) return false;
    bool is_in_order = goal.least > 0.0 && goal.least <= goal.most && goal.most < INFINITY;
    if (goal.is_factor && !(u0 >= 0.0 && is_in_order)) return false;
    if (!border_move(made->scene, one->a, one->a_zero_us, u0, u1, origin, &pair->a)) return false;
    if (!border_move(made->scene, one->b, one->b_zero_us, v0, v1, origin, &pair->b)) return false;
    *whole = (Box){.u0 = u0, .u1 = u1, .v0 = v0, .v1 = v1, .part = part_of(u0, u1, v0, v1)};
    goal_cut_asked(&goal, &whole->part);
    if (whole->part.count > 0) fit(whole);
    /* Limits near the largest number overflow. */
    if (!(whole->u0 <= whole->u1 && whole->v0 <= whole->v1)) return false;
    int64_t n = pair->a.body->count, m = pair->b.body->count, looks = (int64_t)MOST_LOOKS * FEW_VERTICES / (n + m);
    search->looks_left = (int)(looks > MOST_LOOKS ? MOST_LOOKS : looks < LEAST_LOOKS ? LEAST_LOOKS : looks);
    search->cuts.shift.evaluations_left = (int64_t)PLACES_PER_LOOK * search->looks_left;
    search->cuts.shift.goal = goal, search->aim = goal.is_factor ? AIM_S / most(u1, AIM_S) : AIM_S;
    search->cuts.shift.u0 = whole->u0, search->cuts.shift.u1 = whole->u1, search->cuts.shift.v0 = whole->v0,
    search->cuts.shift.v1 = whole->v1;
    cuts_begin(&search->cuts);
    return true;
}

KernelStatus differences_begin(const KernelScene *scene, const KernelPairs *pairs, double reach_m, KernelWork *work,
                               Differences **made) {
    Differences *differences = calloc(1, sizeof *differences);
    *made = NULL;
    if (!differences) return KERNEL_NO_MEMORY;
    differences->scene = scene, differences->pair = (Encounter){.separation_m = reach_m, .work = work};
    Encounter *pair = &differences->pair;
    KernelStatus status = border_begin(scene, pairs, pair, &differences->memory);
    if (status != KERNEL_OK) {
        free(differences);
        return status;
    }
    int64_t largest = pair->a0.y - pair->a0.x;
    Cuts *cuts = &differences->search.cuts;
    differences->search.boxes = malloc(BOXES * sizeof *differences->search.boxes);
    double *halves = differences->halves = malloc(4 * (size_t)largest * sizeof *halves);
    cuts->shift.pair = pair, cuts->shift.reach_m = reach_m;
    for (int k = 0; halves && k < 4; k++) cuts->halves[k] = halves + k * largest;
    cuts->touch_m = 2.0 * KERNEL_TOUCH_M + encounter_distance_error_m(pair, reach_m);
    if (halves && differences->search.boxes) *made = differences;
    else differences_end(differences);
    return *made ? KERNEL_OK : KERNEL_NO_MEMORY;
}

void differences_end(Differences *made) {
    if (!made) return;
    free(made->memory), free(made->search.boxes), free(made->halves);
    free(made);
}

KernelDifference differences_met(Differences *made, const Shifted *one) {
    Box whole;
    double low = one->b_start_s - one->weight * one->a_end_s, high = one->b_end_s - one->weight * one->a_start_s;
    if (one->is_factor) low = one->least, high = one->most;
    if (!(low <= high)) low = -INFINITY, high = INFINITY;
    bool is_valid = begin(made, one, &whole);
    return is_valid ? differences_of(&made->search, &whole) : outer_alone(low, high, KERNEL_DIFFERENCE_UNKNOWN);
}

/* Whether halving the times would tell no more. */
static bool is_known(const Shifted *one, const KernelDifference *found) {
    if (found->state == KERNEL_DIFFERENCE_NONE || found->state == KERNEL_DIFFERENCE_UNKNOWN) return true;
    /* A factor moves the end of a piece by as much more as it is later. */
    double loose = one->is_factor ? LOOSE_S / most(one->a_end_s, LOOSE_S) : LOOSE_S;
    double open = found->outer_high - found->outer_low;
    return open <= found->inner_high - found->inner_low + loose || open <= loose;
}

/* Halve the longer time of a pair. */
static void halve(const Shifted *one, Shifted *first, Shifted *second) {
    *first = *second = *one;
    if (one->a_end_s - one->a_start_s >= one->b_end_s - one->b_start_s)
        first->a_end_s = second->a_start_s = 0.5 * (one->a_start_s + one->a_end_s);
    else first->b_end_s = second->b_start_s = 0.5 * (one->b_start_s + one->b_end_s);
}

int differences_in_parts(Differences *made, const Shifted *one, ShiftedPart *parts) {
    Shifted room[2][DIFFERENCES_PARTS], *open = room[0], *next = room[1];
    int count = 0, left = 1;
    open[0] = *one;
    for (int halvings = 0; left > 0; halvings++) {
        int halved = 0;
        for (int k = 0; k < left; k++) {
            KernelDifference found = differences_met(made, open + k);
            if (halvings < DIFFERENCES_HALVINGS && !is_known(open + k, &found)) {
                halve(open + k, next + halved, next + halved + 1);
                halved += 2;
            } else if (found.state != KERNEL_DIFFERENCE_NONE) parts[count++] = (ShiftedPart){open[k], found};
        }
        Shifted *done = open;
        open = next, next = done, left = halved;
    }
    return count;
}

Shifted differences_asked(const KernelShifts *shifts, int64_t i) {
    return (Shifted){shifts->a[i],
                     shifts->b[i],
                     shifts->a_zero_us[i],
                     shifts->b_zero_us[i],
                     shifts->a_start_s[i],
                     shifts->a_end_s[i],
                     shifts->b_start_s[i],
                     shifts->b_end_s[i],
                     shifts->least[i],
                     shifts->most[i],
                     shifts->weight ? shifts->weight[i] : 1.0,
                     shifts->is_factor != 0};
}

KernelStatus differences_begin_shifts(const KernelScene *scene, const KernelShifts *shifts, double reach_m, KernelWork *work,
                                      Differences **made) {
    if (!scene || !shifts || !work) return KERNEL_NULL;
    bool has_times = shifts->b_zero_us && shifts->b_start_s && shifts->b_end_s && shifts->least && shifts->most;
    if (shifts->count > 0 && !has_times) return KERNEL_NULL;
    KernelPairs pairs = {shifts->count, shifts->a, shifts->b, shifts->a_zero_us, shifts->a_start_s, shifts->a_end_s};
    *work = (KernelWork){0};
    return differences_begin(scene, &pairs, reach_m, work, made);
}

KernelStatus kernel_differences(const KernelScene *scene, const KernelShifts *shifts, double reach_m, KernelDifference *found,
                                KernelWork *work) {
    if (shifts && shifts->count > 0 && !found) return KERNEL_NULL;
    Differences *made;
    KernelStatus status = differences_begin_shifts(scene, shifts, reach_m, work, &made);
    if (status != KERNEL_OK) return status;
    for (int64_t i = 0; i < shifts->count; i++) {
        Shifted one = differences_asked(shifts, i);
        found[i] = differences_met(made, &one);
    }
    differences_end(made);
    return KERNEL_OK;
}

KernelStatus kernel_difference_parts(const KernelScene *scene, const KernelShifts *shifts, double reach_m,
                                     KernelDifferencePart **parts, int64_t *count, KernelWork *work) {
    if (!parts || !count) return KERNEL_NULL;
    Differences *made;
    *parts = NULL, *count = 0;
    KernelStatus status = differences_begin_shifts(scene, shifts, reach_m, work, &made);
    if (status != KERNEL_OK) return status;
    KernelDifferencePart *items = NULL;
    int64_t room = 0, found = 0;
    for (int64_t i = 0; status == KERNEL_OK && i < shifts->count; i++) {
        ShiftedPart met[DIFFERENCES_PARTS];
        Shifted one = differences_asked(shifts, i);
        int n = differences_in_parts(made, &one, met);
        if (found + n > room) {
            room = 2 * (found + n);
            KernelDifferencePart *larger = realloc(items, (size_t)room * sizeof *items);
            if (!larger) status = KERNEL_NO_MEMORY;
            else items = larger;
        }
        for (int k = 0; status == KERNEL_OK && k < n; k++) {
            const Shifted *of = &met[k].of;
            items[found++] = (KernelDifferencePart){i, of->a_start_s, of->a_end_s, of->b_start_s, of->b_end_s, met[k].found};
        }
    }
    differences_end(made);
    if (status != KERNEL_OK) free(items);
    else *parts = items, *count = found;
    return status;
}
