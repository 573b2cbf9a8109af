/* Holds large polygons in runs to the same polygons looked at whole.
 *
 *     compare_runs ROUNDS SEED
 *
 * Prints how many measures there were, how many are the same bit for bit, and the largest difference as a share of the
 * largest coordinate.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "draw.h"
#include "geometry/runs.h"

enum { MOST = 2000, KINDS = 8 };

static Polygon room(void) {
    return (Polygon){.x = malloc(4 * MOST * sizeof(double)), .y = malloc(4 * MOST * sizeof(double)),
                     .bends = malloc((size_t)runs_room(MOST) * sizeof(double))};
}

/* An outline about the origin: of an ellipse, a sliver, a rectangle with many vertices a side, a hull of random points, one
 * that dents by rounding, one whose vertices repeat, a line there and back, a point. */
static void shape(Polygon *polygon, Polygon *spare, int64_t count, int kind, double size) {
    double height = kind == 1 ? 1e-9 : uniform(0.1, 1.0) * size, phase = uniform(0.0, 6.28);
    polygon->count = count, polygon->is_in_runs = false;
    for (int64_t i = 0; i < count; i++) {
        double share = (double)i / (double)count, angle = 2.0 * 3.14159265358979 * share + phase;
        if (kind == 5) angle = 2.0 * 3.14159265358979 * (double)(i / 7) / (double)(count / 7 + 1);
        double x = size * cos(angle), y = height * sin(angle), side = 4.0 * share;
        if (kind == 2) {
            x = side < 1.0 ? size * side : side < 2.0 ? size : side < 3.0 ? size * (3.0 - side) : 0.0;
            y = side < 1.0 ? 0.0 : side < 2.0 ? height * (side - 1.0) : side < 3.0 ? height : height * (4.0 - side);
        }
        if (kind == 3) x = uniform(-size, size), y = uniform(-height, height);
        if (kind == 4) x *= 1.0 + uniform(-1e-15, 1e-15), y *= 1.0 + uniform(-1e-15, 1e-15);
        if (kind == 6) x = size * fabs(2.0 * share - 1.0), y = 0.3 * x;
        if (kind == 7) x = size, y = height;
        polygon->x[i] = x, polygon->y[i] = y;
    }
    if (kind == 3) polygon_hull(polygon, spare);
}

/* Turned and moved, as the vertices of a haven are on its way. */
static void move(Polygon *polygon, double turn, double x, double y) {
    double c = cos(turn), s = sin(turn);
    for (int64_t i = 0; i < polygon->count; i++) {
        double px = polygon->x[i], py = polygon->y[i];
        polygon->x[i] = x + c * px - s * py, polygon->y[i] = y + s * px + c * py;
    }
}

static double largest_of(const Polygon *polygon) {
    double largest = 0.0;
    for (int64_t i = 0; i < polygon->count; i++) largest = fmax(largest, fmax(fabs(polygon->x[i]), fabs(polygon->y[i])));
    return largest;
}

int main(int argc, char **argv) {
    int64_t rounds = argc > 1 ? atoll(argv[1]) : 100, measures = 0, same = 0;
    double worst = 0.0;
    state = argc > 2 ? strtoull(argv[2], NULL, 10) * UINT64_C(0x9E3779B97F4A7C15) + 1 : 1;
    Polygon a = room(), b = room(), spare = room();
    for (int64_t round = 0; round < rounds; round++) {
        double size = pow(10.0, uniform(-2.0, 6.0)), far = pow(10.0, uniform(-8.0, 1.0)) * size;
        int64_t few = below(10) ? 96 : 1, many = below(10) ? 96 : 1;
        shape(&a, &spare, few + below(few > 1 ? MOST - few : 4), (int)below(KINDS), size);
        shape(&b, &spare, many + below(many > 1 ? MOST - many : 4), (int)below(KINDS), size * uniform(0.1, 1.0));
        double turn = below(2) ? uniform(0.0, 6.28) : 0.0, way = uniform(0.0, 6.28);
        move(&a, turn, 0.0, 0.0);
        move(&b, below(2) ? turn : uniform(0.0, 6.28), (size + far) * cos(way), (size + far) * sin(way));
        Vector from, to;
        double whole[3] = {polygon_separation(&a, &b).gap, polygon_distance(&a, &b, &from, &to).gap,
                           polygon_nearest(&a, &b, &from, &to)};
        runs_make(&a, &b);
        double runs[3] = {polygon_separation(&a, &b).gap, polygon_distance(&a, &b, &from, &to).gap,
                          polygon_nearest(&a, &b, &from, &to)};
        for (int k = 0; k < 3; k++, measures++) {
            bool is_none = isnan(whole[k]) && isnan(runs[k]);
            same += is_none || whole[k] == runs[k];
            double off = is_none ? 0.0 : fabs(whole[k] - runs[k]) / fmax(largest_of(&a), largest_of(&b));
            if (!(off <= worst)) worst = off;
        }
        a.is_in_runs = b.is_in_runs = false;
    }
    printf("%lld %lld %a\n", (long long)measures, (long long)same, worst);
    free(a.x), free(a.y), free(a.bends), free(b.x), free(b.y), free(b.bends), free(spare.x), free(spare.y), free(spare.bends);
    return 0;
}
