/* The search on a motion made for it, in the place of the kernel's own: a square that swings towards a wall, as often as
 * one likes. Linked with the kernel's files but motion.c and those that need it (tests/unit/test_search.py). */
#include <math.h>
#include <stdlib.h>

#include "narrow/answers.h"
#include "narrow/search.h"

static const double SIDE_M = 1.0, BY_M = 50.0, RATE = 0x1.921fb54442d18p2 / 100.0;
enum { INTERVALS = 8192, ROOM = 64 };

/* A mover's into_s tells where the middle of the square swings about, to the east. */
static double east(const Mover *mover, double t) { return mover->into_s + BY_M * cos(RATE * t); }

void mover_focus(Mover *mover, double t0, double t1) { (void)mover, (void)t0, (void)t1; }

void mover_place(const Mover *mover, double t, Polygon *polygon) {
    static const double SQUARE[4][2] = {{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}};
    static const double WALL[4][2] = {{-300.0, -1.0}, {0.0, -1.0}, {0.0, 1.0}, {-300.0, 1.0}};
    bool stands = mover->body->motion == STANDS_STILL;
    polygon->count = 4;
    for (int i = 0; i < 4; i++) {
        polygon->x[i] = stands ? WALL[i][0] : east(mover, t) + SIDE_M * SQUARE[i][0];
        polygon->y[i] = stands ? WALL[i][1] : SIDE_M * SQUARE[i][1];
    }
}

Vector mover_velocity(const Mover *mover, double t) {
    return (Vector){mover->body->motion == STANDS_STILL ? 0.0 : -RATE * BY_M * sin(RATE * t), 0.0};
}

Bounds mover_bounds(const Mover *mover, double t0, double t1) {
    double acceleration = mover->body->motion == STANDS_STILL ? 0.0 : RATE * RATE * BY_M;
    return (Bounds){acceleration, 0.5 * (t1 - t0) * acceleration};
}

Acceleration mover_acceleration(const Mover *mover, double t0, double t1) {
    return (Acceleration){{0.0, 0.0}, mover_bounds(mover, t0, t1).acceleration};
}

void answers_add(Answers *answers, double start, double end, double error, KernelVerdict verdict, bool touches) {
    if (answers->count == ROOM) abort();
    answers->items[answers->count++] = (KernelContact){0, start, end, error, verdict, touches};
}

/* Find when the square, which comes as near as least_m more than wanted, is in contact; found: (64,). Return how often. */
int swings(const KernelPlane *plane, double least_m, double separation_m, double tolerance_m, double low, double high,
           KernelContact *found) {
    static double room[8][16];
    Body wall = {.motion = STANDS_STILL, .is_sound = true, .is_convex = true, .count = 4};
    Body square = {.motion = ON_RHUMB_LINE, .is_sound = true, .is_convex = true, .count = 4};
    KernelWork work = {0};
    Encounter pair = {.plane = plane, .a = {.body = &wall}, .b = {.body = &square}, .looks_left = 131072, .parts_left = PLANE_MAX_PARTS, .work = &work};
    pair.b.into_s = least_m + separation_m + SIDE_M + BY_M;
    Polygon *polygons[] = {&pair.a0, &pair.b0, &pair.a1, &pair.b1, &pair.a_now, &pair.b_now, &pair.spare};
    for (int k = 0; k < 7; k++) polygons[k]->x = room[k], polygons[k]->y = room[k] + 8;
    Intervals *intervals[] = {&pair.undecided, &pair.deeper, &pair.spare_time};
    Interval *memory = malloc(3 * INTERVALS * sizeof *memory);
    if (!memory) abort();
    for (int k = 0; k < 3; k++) *intervals[k] = (Intervals){memory + k * INTERVALS, 0, INTERVALS};
    Answers answers = {.items = found};
    Guess guess = {0};
    encounter_ask(&pair, separation_m, tolerance_m);
    find_contacts(&pair, low, high, INFINITY, &guess, &answers);
    free(memory);
    return (int)answers.count;
}
