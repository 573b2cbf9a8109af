/* Root finding: secant steps through the last two instants if they stay inside the bracket; else regula falsi (M.
 * Dowell, P. Jarratt, "A modified regula falsi method", BIT 11 (1971), doi:10.1007/BF01934364); and bisection if
 * neither narrows the bracket much, as for functions that only just fall below zero. */
#include "geometry/roots.h"

#include <math.h>

/* Steps of one search. Bisection takes 60 to the last digit, and at worst every fourth step is one. Smaller: brackets
 * stay wide and pairs are undecided. */
enum { MAX_STEPS = 300 };
/* Consecutive steps that may fail to halve a bracket before a bisection. */
enum { SLOW_STEPS = 3 };
/* An end is certified if abs(f) is between 1 and MOST_TOUCHES rounding error bounds. */
static const double MOST_TOUCHES = 3.0;
/* Instants within this many float64 spacings are equal. */
static const double RESOLVED_SPACINGS = 4.0;

/* Width of crossings, seconds: a hundredth of a timestamp's resolution. Larger: ends may round to other microseconds.
 */
static const double BRACKET_S = 1e-8;

/* Two instants between which a function falls, and its values there. */
typedef struct {
    double outside, gap, inside, depth;
} Bracket;

/* The remaining bracket, and the instant with the requested value, or else the inner end. is_wide: the steps were
 * exhausted; if neither, the bracket is as narrow as float64 allows. */
typedef struct {
    Bracket left;
    double at, value;
    bool is_found, is_wide;
} Narrowed;

/* Whether there are instants between two. */
static bool resolved(double a, double b) {
    double larger = fabs(a) > fabs(b) ? fabs(a) : fabs(b);
    return fabs(b - a) > RESOLVED_SPACINGS * (nextafter(larger, INFINITY) - larger);
}

/* Narrow a bracket until the function is between `low` and `high` at an instant. guess: the first instant to try, or
 * NaN. */
static Narrowed narrowed(Measure *measure, void *of, Bracket bracket, double low, double high, double guess) {
    double a = bracket.outside, fa = bracket.gap, b = bracket.inside, fb = bracket.depth, aim = 0.5 * (low + high);
    if (fa < high) return (Narrowed){bracket, a, fa, true, false};
    if (fb > low) return (Narrowed){bracket, b, fb, true, false};
    /* Values at the ends; an end that stays twice counts half, so that the other one moves. */
    double ga = fa - aim, gb = fb - aim;
    /* The last two instants and their values. */
    double now = b, f_now = fb, before = a, f_before = fa;
    int side = 0, slow = 0;
    for (int step = 0; step < MAX_STEPS; step++) {
        if (!resolved(a, b)) return (Narrowed){{a, fa, b, fb}, b, fb, false, false};
        double width = fabs(b - a), x = step == 0 ? guess : now + (now - before) * ((aim - f_now) / (f_now - f_before));
        if (!((x - a) * (x - b) < 0.0)) x = a + (b - a) * (ga / (ga - gb));
        if (!((x - a) * (x - b) < 0.0) || slow >= SLOW_STEPS) x = 0.5 * (a + b);
        double f = measure(of, x);
        /* After a guess the secant starts at the end from which it was made. */
        before = step == 0 && isfinite(guess) ? a : now, f_before = step == 0 && isfinite(guess) ? fa : f_now;
        now = x, f_now = f;
        if (f > low && f < high) return (Narrowed){{a, fa, b, fb}, x, f, true, false};
        if (f >= high) {
            if (side == 1) gb *= 0.5;
            a = x, fa = f, ga = f - aim, side = 1;
        } else {
            if (side == -1) ga *= 0.5;
            b = x, fb = f, gb = f - aim, side = -1;
        }
        slow = fabs(b - a) <= 0.5 * width ? 0 : slow + 1;
    }
    return (Narrowed){{a, fa, b, fb}, b, fb, false, resolved(a, b)};
}

/* Seconds per metre at an instant of a bracket, from the nearer end. */
static double pace_at(double at, double value, Bracket bracket) {
    double before = (bracket.outside - at) / (bracket.gap - value), after = (at - bracket.inside) / (value - bracket.depth);
    bool is_before = bracket.outside != at && fabs(bracket.outside - at) < fabs(at - bracket.inside);
    return is_before ? before : after;
}

Root root_between(Measure *measure, void *of, double outside, double gap, double inside, double depth, double touch,
                  double pace) {
    double aim = 0.5 * (1.0 + MOST_TOUCHES) * touch;
    Bracket whole = {outside, gap, inside, depth};
    Narrowed outer = narrowed(measure, of, whole, touch, MOST_TOUCHES * touch, outside + pace * (aim - gap));
    /* If float64 cannot reach that, the bracket remains. */
    Bracket rest = outer.left;
    if (outer.is_found) rest.outside = outer.at, rest.gap = outer.value;
    if (!(rest.depth < -touch)) rest.inside = inside, rest.depth = depth;
    double guess = outer.is_found ? outer.at - (aim + outer.value) * pace_at(outer.at, outer.value, outer.left) : NAN;
    Narrowed inner = narrowed(measure, of, rest, -MOST_TOUCHES * touch, -touch, guess);
    double below = inner.is_found ? inner.value : inner.left.depth;
    return (Root){
        .outer = rest.outside,
        .inner = inner.is_found ? inner.at : inner.left.inside,
        .is_found = !outer.is_wide && !inner.is_wide && rest.gap > touch && below < -touch,
    };
}

Crossing crossing_between(Measure *measure, void *of, double level, double outside, double inside) {
    double above = measure(of, outside) - level, below = measure(of, inside) - level;
    if (!(above > 0.0)) return (Crossing){outside, outside};
    int side = 0;
    for (int step = 0; step < MAX_STEPS && fabs(outside - inside) > BRACKET_S && resolved(outside, inside); step++) {
        /* Every third step is a bisection; the others overstep by less than BRACKET_S, so that the other end follows.
         */
        double width = inside - outside, share = step % 3 < 2 ? above / (above - below) : 0.5;
        if (!isfinite(share)) share = 0.5;
        else if (step % 3 < 2) share += 0.4 * BRACKET_S / fabs(width) * (side > 0 ? 1.0 : -1.0);
        double at = outside + share * width;
        if (!((at - outside) * (at - inside) < 0.0)) at = outside + 0.5 * width;
        double found = measure(of, at) - level;
        if (found > 0.0) {
            if (side == 1) below *= 0.5;
            outside = at, above = found, side = 1;
        } else {
            if (side == -1) above *= 0.5;
            inside = at, below = found, side = -1;
        }
    }
    return (Crossing){outside, inside};
}
