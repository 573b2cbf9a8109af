#include "geometry/runs.h"

#include <math.h>

#include "planes/earth.h"

/* The shortest runs have 2^5 sides; 2^3 runs form a longer one. */
enum { RUN_BITS = 5, FAN_BITS = 3, FAN = 1 << FAN_BITS };
/* Polygons of fewer vertices are not divided: comparing all sides takes less time. */
enum { LARGE = 96 };
/* Projections within this fraction of the largest coordinate are equal: twice their rounding error, 4e-10 m within 1000
 * km. Smaller: straight sides of many vertices are inspected vertex by vertex. */
static const double SLACK = 0x1p-51;

/* Run i of a level, 0 the shortest. */
typedef struct {
    int level;
    int64_t i;
} Run;

/* Sides of a run, and number of runs of a level. */
static int64_t length_of(int level) { return INT64_C(1) << (RUN_BITS + FAN_BITS * level); }

static int64_t runs_of(const Polygon *polygon, int level) {
    return (polygon->count + length_of(level) - 1) >> (RUN_BITS + FAN_BITS * level);
}

/* Index of a run's bend. */
static int64_t place_of(const Polygon *polygon, Run run) {
    int64_t place = run.i;
    for (int level = 0; level < run.level; level++) place += runs_of(polygon, level);
    return place;
}

/* The vertices of a run, ends included; its sides are all but the last. */
static Range range_of(const Polygon *polygon, Run run) {
    int64_t length = length_of(run.level), first = run.i * length, end = first + length;
    return (Range){first, end < polygon->count ? end : polygon->count};
}

static inline int64_t home(const Polygon *polygon, int64_t i) { return i < polygon->count ? i : i - polygon->count; }

static Run root_of(const Polygon *polygon) {
    Run root = {0, 0};
    while (runs_of(polygon, root.level) > 1) root.level++;
    return root;
}

static double bend(const Polygon *polygon, Run run) { return polygon->bends[place_of(polygon, run)]; }

static double furthest_from_chord(const Polygon *polygon, Range range) {
    int64_t last = home(polygon, range.end);
    double x = polygon->x[range.first], y = polygon->y[range.first], furthest = 0.0;
    Vector chord = {polygon->x[last] - x, polygon->y[last] - y};
    for (int64_t i = range.first + 1; i < range.end; i++) {
        double square = squared_distance((Vector){polygon->x[i] - x, polygon->y[i] - y}, chord);
        if (!(square <= furthest)) furthest = square;
    }
    return sqrt(furthest);
}

static void make(Polygon *polygon) {
    polygon->is_in_runs = true, polygon->largest = 0.0;
    for (int64_t i = 0; i < polygon->count; i++)
        polygon->largest = most(polygon->largest, most(fabs(polygon->x[i]), fabs(polygon->y[i])));
    double *bends = polygon->bends;
    for (int level = 0, top = root_of(polygon).level; level <= top; level++)
        for (int64_t i = 0; i < runs_of(polygon, level); i++)
            *bends++ = furthest_from_chord(polygon, range_of(polygon, (Run){level, i}));
}

void runs_make(Polygon *a, Polygon *b) {
    if (a->count >= LARGE && b->count >= LARGE) make(a), make(b);
}

/* A projection, and the smallest value found. */
typedef struct {
    const Polygon *polygon;
    double nx, ny, length, slack, least;
    int64_t vertex;
} Along;

static double look_along(Along *along, int64_t i) {
    double found = along->nx * along->polygon->x[i] + along->ny * along->polygon->y[i];
    if (found < along->least) along->least = found, along->vertex = i;
    return found;
}

static void descend(Along *along, Run run) {
    const Polygon *polygon = along->polygon;
    Range range = range_of(polygon, run);
    if (run.level == 0) {
        for (int64_t i = range.first + 1; i < range.end; i++) look_along(along, i);
        return;
    }
    double bounds[FAN];
    int nearest = 0, runs = 0;
    int64_t step = length_of(run.level - 1), first = place_of(polygon, (Run){run.level - 1, run.i * FAN});
    double before = look_along(along, range.first);
    for (int64_t start = range.first; start < range.end; start += step, runs++) {
        int64_t end = start + step < range.end ? start + step : range.end;
        double after = look_along(along, home(polygon, end));
        bounds[runs] = (before < after ? before : after) - polygon->bends[first + runs] * along->length;
        if (bounds[runs] < bounds[nearest]) nearest = runs;
        before = after;
    }
    descend(along, (Run){run.level - 1, run.i * FAN + nearest});
    for (int k = 0; k < runs; k++)
        if (k != nearest && !(bounds[k] >= along->least - along->slack)) descend(along, (Run){run.level - 1, run.i * FAN + k});
}

double runs_least_along(double nx, double ny, const Polygon *polygon, int64_t *vertex) {
    REQUIRE(polygon->is_in_runs);
    double length = sqrt(nx * nx + ny * ny);
    Along along = {polygon, nx, ny, length, SLACK * polygon->largest * length, INFINITY, 0};
    descend(&along, root_of(polygon));
    *vertex = along.vertex;
    return along.least < INFINITY ? along.least : NAN;
}

/* Two polygons, the callback, and the distance within which others matter. */
typedef struct {
    const Polygon *a, *b;
    Look *look;
    void *of;
    double reach, slack;
} Visit;

static Vector vertex_of(const Polygon *polygon, int64_t i) { return (Vector){polygon->x[i], polygon->y[i]}; }
static Vector way(Vector from, Vector to) { return (Vector){to.x - from.x, to.y - from.y}; }
static double turn(Vector a, Vector b) { return a.x * b.y - a.y * b.x; }

/* The distance of two segments: from an end of one to the other, or 0 if they cross. */
static double between(Vector a, Vector a_end, Vector b, Vector b_end) {
    Vector of_a = way(a, a_end), of_b = way(b, b_end);
    bool crosses_a = (turn(of_a, way(a, b)) < 0.0) != (turn(of_a, way(a, b_end)) < 0.0);
    bool crosses_b = (turn(of_b, way(b, a)) < 0.0) != (turn(of_b, way(b, a_end)) < 0.0);
    if (crosses_a && crosses_b) return 0.0;
    double square = least(squared_distance(way(a, b), of_a), squared_distance(way(a, b_end), of_a));
    square = least(square, least(squared_distance(way(b, a), of_b), squared_distance(way(b, a_end), of_b)));
    return sqrt(square);
}

/* Lower bound on the distance of two runs. */
static double apart(const Visit *visit, Run a, Run b) {
    Range in_a = range_of(visit->a, a), in_b = range_of(visit->b, b);
    double chords = between(vertex_of(visit->a, in_a.first), vertex_of(visit->a, home(visit->a, in_a.end)),
                            vertex_of(visit->b, in_b.first), vertex_of(visit->b, home(visit->b, in_b.end)));
    return chords - bend(visit->a, a) - bend(visit->b, b);
}

static void meet(Visit *visit, Run a, Run b) {
    if (a.level == 0 && b.level == 0) {
        Range in_a = range_of(visit->a, a), in_b = range_of(visit->b, b);
        visit->reach = visit->look(visit->of, visit->a, in_a, visit->b, in_b);
        visit->reach = visit->look(visit->of, visit->b, in_b, visit->a, in_a);
        return;
    }
    /* Divide the longer run, and visit its nearest part first. */
    bool is_a = a.level > b.level || (a.level == b.level && bend(visit->a, a) >= bend(visit->b, b));
    Run *taken = is_a ? &a : &b;
    int64_t all = runs_of(is_a ? visit->a : visit->b, --taken->level), first = taken->i * FAN;
    double bounds[FAN];
    int runs = 0, nearest = 0;
    for (; runs < FAN && first + runs < all; runs++) {
        taken->i = first + runs;
        bounds[runs] = apart(visit, a, b);
        if (bounds[runs] < bounds[nearest]) nearest = runs;
    }
    for (int k = -1; k < runs; k++) {
        int next = k < 0 ? nearest : k;
        if (k == nearest || bounds[next] >= visit->reach - visit->slack) continue;
        taken->i = first + next;
        meet(visit, a, b);
    }
}

void runs_visit(const Polygon *a, const Polygon *b, double reach, Look *look, void *of) {
    if (a->is_in_runs && b->is_in_runs) {
        Visit visit = {a, b, look, of, reach, SLACK * most(a->largest, b->largest)};
        meet(&visit, root_of(a), root_of(b));
        return;
    }
    look(of, a, (Range){0, a->count}, b, (Range){0, b->count});
    look(of, b, (Range){0, b->count}, a, (Range){0, a->count});
}
