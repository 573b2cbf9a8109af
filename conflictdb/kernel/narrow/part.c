#include "narrow/part.h"

Part part_of(double u0, double u1, double v0, double v1) { return (Part){4, {{u0, v0}, {u1, v0}, {u1, v1}, {u0, v1}}}; }

/* Clip by I. E. Sutherland and G. W. Hodgman, "Reentrant polygon clipping", CACM 17 (1974), doi:10.1145/360767.360802. */
void part_cut(Part *part, double a, double b, double c) {
    Part kept;
    kept.count = 0;
    if (part->count == 0) return;
    Times before = part->corner[part->count - 1];
    double last = a * before.u + b * before.v + c;
    for (int i = 0; i < part->count; i++) {
        Times here = part->corner[i];
        double now = a * here.u + b * here.v + c;
        if (kept.count + 2 > PART_CORNERS) return;
        if ((now > 0.0) != (last > 0.0)) {
            double s = last / (last - now);
            kept.corner[kept.count++] = (Times){before.u + s * (here.u - before.u), before.v + s * (here.v - before.v)};
        }
        if (!(now > 0.0)) kept.corner[kept.count++] = here;
        before = here, last = now;
    }
    part->count = kept.count;
    for (int i = 0; i < kept.count; i++) part->corner[i] = kept.corner[i];
}

Times part_middle(const Part *part) {
    Times middle = {0.0, 0.0};
    for (int i = 0; i < part->count; i++)
        middle.u += part->corner[i].u / part->count, middle.v += part->corner[i].v / part->count;
    return middle;
}
