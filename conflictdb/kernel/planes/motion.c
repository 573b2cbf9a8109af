#include "planes/motion.h"

Mover mover_make(const Scene *scene, const Body *body, int64_t zero_us, Vector origin, double *frame) {
    REQUIRE(body->is_sound && body->count > 0);
    Mover mover = {.scene = scene, .body = body, .origin = origin, .frame = frame};
    if (body->motion == STANDS_STILL) return mover;
    mover.into_s = (double)(zero_us - body->leg_start_us) / 1e6;
    if (body->motion == ON_GREAT_CIRCLE) circle_count_from(&mover);
    return mover;
}

static void place_still(const Mover *mover, Polygon *polygon) {
    const double *x = body_column(mover->scene, mover->body, 0), *y = body_column(mover->scene, mover->body, 1);
    for (int64_t i = 0; i < mover->body->count; i++) {
        polygon->x[i] = x[i] - mover->origin.x;
        polygon->y[i] = y[i] - mover->origin.y;
    }
}

bool mover_is_there(const Mover *mover, double t0, double t1) {
    return mover->body->motion != ON_RHUMB_LINE || rhumb_is_there(mover, t0, t1);
}

void mover_focus(Mover *mover, double t0, double t1) {
    REQUIRE(t0 <= t1);
    if (mover->body->motion == ON_RHUMB_LINE) rhumb_focus(mover, t0, t1);
}

void mover_place(const Mover *mover, double t, Polygon *polygon) {
    polygon->count = mover->body->count, polygon->is_in_runs = false;
    switch (mover->body->motion) {
        case STANDS_STILL: place_still(mover, polygon); return;
        case ON_RHUMB_LINE: rhumb_place(mover, t, polygon); return;
        case ON_GREAT_CIRCLE: circle_place(mover, t, polygon); return;
    }
}

Vector mover_velocity(const Mover *mover, double t) {
    switch (mover->body->motion) {
        case STANDS_STILL: break;
        case ON_RHUMB_LINE: return rhumb_velocity(mover, t);
        case ON_GREAT_CIRCLE: return circle_velocity(mover, t);
    }
    return (Vector){0.0, 0.0};
}

Bounds mover_bounds(const Mover *mover, double t0, double t1) {
    switch (mover->body->motion) {
        case STANDS_STILL: break;
        case ON_RHUMB_LINE: return rhumb_bounds(mover, t0, t1);
        case ON_GREAT_CIRCLE: return circle_bounds(mover, t0, t1);
    }
    return (Bounds){0.0, 0.0};
}

Acceleration mover_acceleration(const Mover *mover, double t0, double t1) {
    switch (mover->body->motion) {
        case STANDS_STILL: break;
        case ON_RHUMB_LINE: return rhumb_acceleration(mover, t0, t1);
        case ON_GREAT_CIRCLE: return circle_acceleration(mover, t0, t1);
    }
    return (Acceleration){{0.0, 0.0}, 0.0};
}

Vector mover_reference(const Mover *mover, double t) {
    switch (mover->body->motion) {
        case STANDS_STILL: break;
        case ON_RHUMB_LINE: return rhumb_reference(mover, t);
        case ON_GREAT_CIRCLE: return circle_reference(mover, t);
    }
    return (Vector){0.0, 0.0};
}

Sweep mover_sweep(const Mover *mover, double t0, double t1, double change) {
    switch (mover->body->motion) {
        case STANDS_STILL: break;
        case ON_RHUMB_LINE: return rhumb_sweep(mover, t0, t1, change);
        case ON_GREAT_CIRCLE: return circle_sweep(mover, t0, t1, change);
    }
    return (Sweep){0.0, 1.0};
}

static Vector outline_side(const double *shape, int64_t from, int64_t to, double unit_m) {
    return (Vector){shape[2 * to] / unit_m - shape[2 * from] / unit_m,
                    shape[2 * to + 1] / unit_m - shape[2 * from + 1] / unit_m};
}

Corner corner_of(const KernelPieces *pieces, const Body *body, int64_t i, double unit_m) {
    int64_t n = body->count, here = body->first + i, next = body->first + (i + 1) % n, after = body->first + (i + 2) % n;
    Corner corner = {.side = outline_side(pieces->shape, here, next, unit_m),
                     .next = outline_side(pieces->shape, next, after, unit_m)};
    corner.last_side = corner.side, corner.last_next = corner.next;
    if (!body->changes) return corner;
    corner.last_side = outline_side(pieces->shape_to, here, next, unit_m);
    corner.last_next = outline_side(pieces->shape_to, next, after, unit_m);
    corner.changes = corner.last_side.x != corner.side.x || corner.last_side.y != corner.side.y ||
                     corner.last_next.x != corner.next.x || corner.last_next.y != corner.next.y;
    return corner;
}

double corner_least_turn(const Corner *corner) {
    double between = 0.5 * (cross(corner->side, corner->last_next) + cross(corner->last_side, corner->next));
    double ends = least(cross(corner->side, corner->next), cross(corner->last_side, corner->last_next));
    return least(ends, between);
}
