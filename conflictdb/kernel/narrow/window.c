/* Along a fixed direction the gap of polygons whose vertices move along their chords is concave in time, so its chord
 * proves when the pair is apart. The directions are the edge normals of both polygons. */
#include "narrow/window.h"

#include "geometry/runs.h"

static void narrow(Share *share, double g0, double g1) {
    if (g0 > 0.0) share->u = g1 > 0.0 ? 2.0 : most(g0 / (g0 - g1), share->u);
    else if (g1 > 0.0) share->v = least(g0 / (g0 - g1), share->v);
}

/* Narrow by the gap along a normal of this length, at both ends of the time. */
static void narrow_all(Shares *shares, double g0, double g1, double length, Levels levels) {
    narrow(&shares->deep, g0 - levels.deep * length, g1 - levels.deep * length);
    narrow(&shares->touch, g0 - levels.touch * length, g1 - levels.touch * length);
    narrow(&shares->near, g0 - levels.near * length, g1 - levels.near * length);
}

static bool are_same(Share one, Share other) { return one.u == other.u && one.v == other.v; }

/* Whether upper bounds on gaps leave all fractions unchanged; then the gaps themselves do. */
static bool are_kept(const Shares *shares, double g0, double g1, double length, Levels levels) {
    Shares narrowed = *shares;
    narrow_all(&narrowed, g0, g1, length, levels);
    return are_same(narrowed.deep, shares->deep) && are_same(narrowed.touch, shares->touch) &&
           are_same(narrowed.near, shares->near);
}

/* Narrow by the edge normals of `mine`; 0 and 1: the polygons at both ends of the time. */
static void narrow_by_edges(Shares *shares, const Polygon *mine0, const Polygon *mine1, const Polygon *other0,
                            const Polygon *other1, bool stands_still, Levels levels) {
    int64_t n = mine0->count;
    Ahead ahead0 = ahead_of(mine0, other0), ahead1 = ahead_of(mine1, other1);
    Ahead own_ahead0 = ahead_of(other0, mine0), own_ahead1 = ahead_of(other1, mine1);
    for (int64_t step = ahead0.step; step > 0; step = finer(step))
        for (int64_t k = 0; k < n && n > 1; k += step) {
            int64_t m = edge_end(mine0, k);
            double nx = (mine0->y[m] + mine1->y[m]) - (mine0->y[k] + mine1->y[k]);
            double ny = (mine0->x[k] + mine1->x[k]) - (mine0->x[m] + mine1->x[m]);
            double length = sqrt(nx * nx + ny * ny), own0 = nx * mine0->x[k] + ny * mine0->y[k], own1 = own0;
            if (ahead0.is_in_runs) {
                if (!stands_still) own1 = nx * mine1->x[k] + ny * mine1->y[k];
                double g0 = ahead_at(nx, ny, &ahead0) - own0, g1 = ahead_at(nx, ny, &ahead1) - own1;
                if (!(most(g0, g1) > levels.deep * length) || are_kept(shares, g0, g1, length, levels)) continue;
            }
            /* For a polygon that stands still the edge itself is its extreme. */
            if (!stands_still || n == 2) {
                own0 = -ahead_along(-nx, -ny, &own_ahead0), own1 = -ahead_along(-nx, -ny, &own_ahead1);
            }
            double g0 = ahead_along(nx, ny, &ahead0) - own0, g1 = ahead_along(nx, ny, &ahead1) - own1;
            if (!(most(g0, g1) > levels.deep * length)) continue;
            narrow_all(shares, g0, g1, length, levels);
            if (is_none(shares->near)) return;
        }
}

Shares window_shares(Encounter *pair, Levels levels) {
    Shares shares = {{0.0, 1.0}, {0.0, 1.0}, {0.0, 1.0}};
    runs_make(&pair->a0, &pair->b0), runs_make(&pair->a1, &pair->b1);
    bool a_stands = pair->a.body->motion == STANDS_STILL, b_stands = pair->b.body->motion == STANDS_STILL;
    narrow_by_edges(&shares, &pair->a0, &pair->a1, &pair->b0, &pair->b1, a_stands, levels);
    if (is_none(shares.near)) return shares;
    narrow_by_edges(&shares, &pair->b0, &pair->b1, &pair->a0, &pair->a1, b_stands, levels);
    return shares;
}

Share window_share_along(const Encounter *pair, Vector axis, double level, Share share) {
    narrow(&share, gap_along(axis, &pair->a0, &pair->b0) - level, gap_along(axis, &pair->a1, &pair->b1) - level);
    return share;
}
