/* Tracks as their waypoints give them: headings of legs, havens that grow, and places in degrees. */
#include <stddef.h>

#include "planes/motion.h"
#include "planes/plane.h"
#include "scene/border.h"

#define RADIANS (3.14159265358979323846 / 180.0)

static double shorter(double degrees) { return fabs(degrees) > 180.0 ? degrees - 360.0 * rint(degrees / 360.0) : degrees; }

/* The headings of a leg at its start and at its end, degrees; false if it stands still. */
static bool headings_of(const KernelPlane *plane, const double *from, const double *to, double heading[2]) {
    double turn = RADIANS * shorter(to[0] - from[0]), lat = RADIANS * from[1], next = RADIANS * to[1];
    if (turn == 0.0 && lat == next) return false;
    if (plane->projection == KERNEL_MERCATOR) {
        double mu = earth_rectifying(plane, lat), mu_next = earth_rectifying(plane, next);
        heading[0] = heading[1] = atan2(turn / earth_stretch(plane, mu, mu_next), mu_next - mu) / RADIANS;
        return true;
    }
    /* From differences, so that short legs keep their digits. */
    double half = sin(0.5 * turn), bend = 2.0 * half * half;
    double east = cos(next) * sin(turn), north = sin(next - lat) + sin(lat) * cos(next) * bend;
    double back = cos(lat) * sin(turn), forth = sin(next - lat) - sin(next) * cos(lat) * bend;
    heading[0] = atan2(east, north) / RADIANS, heading[1] = atan2(back, forth) / RADIANS;
    return true;
}

/* The difference of a heading between two notations of a place: only a pole has more than one meridian. */
static double meridians_apart(const double *place, const double *same) {
    return place[1] == 0.0 ? 0.0 : copysign(place[0] - same[0], place[1] * (place[0] - same[0]));
}

KernelStatus kernel_headings(const KernelPlane *plane, const double *place_deg, int64_t count, double *bearing_deg) {
    if (!plane || (count > 0 && !place_deg) || (count > 1 && !bearing_deg)) return KERNEL_NULL;
    if (count < 0) return KERNEL_BAD_COUNT;
    KernelStatus status = border_check_plane(plane);
    if (status != KERNEL_OK) return status;
    double last = 0.0, heading[2];
    const double *arrived = NULL;
    int64_t waiting = 0;
    for (int64_t i = 0; i + 1 < count; i++) {
        const double *place = place_deg + 2 * i;
        if (headings_of(plane, place, place + 2, heading)) {
            /* Those that stand still before the first leg that moves have its heading. */
            for (; waiting > 0; waiting--) bearing_deg[i - waiting] = heading[0] + meridians_apart(place - 2 * waiting, place);
            bearing_deg[i] = heading[0], last = heading[1], arrived = place + 2;
        } else {
            bearing_deg[i] = arrived ? last + meridians_apart(place, arrived) : 0.0;
            waiting += arrived ? 0 : 1;
        }
    }
    return KERNEL_OK;
}

KernelStatus kernel_degrees(const KernelPlane *plane, const double *xy, int64_t count, double *degrees) {
    if (!plane || (count > 0 && (!xy || !degrees))) return KERNEL_NULL;
    if (count < 0) return KERNEL_BAD_COUNT;
    KernelStatus status = border_check_plane(plane);
    if (status != KERNEL_OK) return status;
    for (int64_t i = 0; i < count; i++) {
        Vector place = {xy[i], xy[count + i]};
        plane_degrees(plane, place, degrees + 2 * i);
    }
    return KERNEL_OK;
}

static Vector unit(Vector v) {
    double length = norm(v);
    return (Vector){v.x / length, v.y / length};
}

KernelStatus kernel_mitred(const double *outline, int64_t count, double *corner, double *rate, int64_t *corners) {
    if (!corners || (count > 0 && !outline) || !corner || !rate) return KERNEL_NULL;
    if (count < 1) return KERNEL_BAD_COUNT;
    int64_t n = 0;
    for (int64_t i = 0; i < count; i++) {
        const double *before = outline + 2 * ((i + count - 1) % count);
        if (outline[2 * i] == before[0] && outline[2 * i + 1] == before[1]) continue;
        corner[2 * n] = outline[2 * i], corner[2 * n + 1] = outline[2 * i + 1], n++;
    }
    if (n <= 2) {
        static const double along[] = {-1.0, 1.0, 1.0, -1.0}, right[] = {1.0, 1.0, -1.0, -1.0};
        Vector first = n ? (Vector){corner[0], corner[1]} : (Vector){outline[0], outline[1]};
        Vector last = n == 2 ? (Vector){corner[2], corner[3]} : first;
        Vector ahead = n == 2 ? unit((Vector){last.x - first.x, last.y - first.y}) : (Vector){0.0, 1.0};
        for (int64_t i = 0; i < 4; i++) {
            Vector end = along[i] < 0.0 ? first : last;
            corner[2 * i] = end.x, corner[2 * i + 1] = end.y;
            rate[2 * i] = along[i] * ahead.x + right[i] * ahead.y, rate[2 * i + 1] = along[i] * ahead.y - right[i] * ahead.x;
        }
        *corners = 4;
        return KERNEL_OK;
    }
    double doubled = 0.0;
    for (int64_t i = 0; i < n; i++) {
        const double *here = corner + 2 * i, *next = corner + 2 * ((i + 1) % n);
        doubled += here[0] * next[1] - here[1] * next[0];
    }
    double way = doubled < 0.0 ? -1.0 : 1.0;
    for (int64_t i = 0; i < n; i++) {
        const double *before = corner + 2 * ((i + n - 1) % n), *here = corner + 2 * i, *next = corner + 2 * ((i + 1) % n);
        Vector in = unit((Vector){here[0] - before[0], here[1] - before[1]});
        Vector out = unit((Vector){next[0] - here[0], next[1] - here[1]});
        double scale = way / (1.0 + (in.x * out.x + in.y * out.y));
        rate[2 * i] = (in.y + out.y) * scale, rate[2 * i + 1] = -(in.x + out.x) * scale;
    }
    *corners = n;
    return KERNEL_OK;
}
