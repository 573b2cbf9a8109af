/* Two ships meet head-on on the equator: when are their havens in contact?
 *
 *     python conflictdb/kernel/build.py ~/kernel
 *     cc two_ships.c $(PKG_CONFIG_PATH=~/kernel/lib/pkgconfig pkg-config --cflags --libs conflictdb-kernel) -o two_ships
 *     LD_LIBRARY_PATH=~/kernel/lib ./two_ships
 */
#include <conflictdb/kernel.h>
#include <stdio.h>

#define SHIPS 2
#define SIDES 4
#define RADIUS_M 6371008.771415
#define HOUR_US INT64_C(3600000000)

static const char *VERDICTS[] = {"conflict", "grazing", "unresolved"};

int main(void) {
    if (kernel_abi() != KERNEL_ABI) {
        fprintf(stderr, "two_ships: compiled for kernel %d, and the library is %d\n", KERNEL_ABI, kernel_abi());
        return 1;
    }
    /* Rhumb lines on the sphere. */
    KernelPlane plane = {.projection = KERNEL_MERCATOR, .radius_m = RADIUS_M, .rectifying_m = RADIUS_M};
    plane.conformal_radius[0] = RADIUS_M;

    /* Each sails a tenth of a degree in an hour. Their havens reach 100 m ahead, 50 m astern and 20 m to each side. */
    const int8_t moves[SHIPS] = {1, 1};
    const int16_t turn[SHIPS] = {0, 0};
    const int64_t start_us[SHIPS] = {0, 0}, end_us[SHIPS] = {HOUR_US, HOUR_US};
    const double leg_start_deg[2 * SHIPS] = {0.0, 0.0, 0.1, 0.0}, leg_end_deg[2 * SHIPS] = {0.1, 0.0, 0.0, 0.0};
    const double bearing_deg[SHIPS] = {90.0, 270.0};
    const int64_t shape_offset[SHIPS + 1] = {0, SIDES, 2 * SIDES};
    const double shape[2 * SHIPS * SIDES] = {20.0, -50.0, 20.0, 100.0, -20.0, 100.0, -20.0, -50.0,
                                             20.0, -50.0, 20.0, 100.0, -20.0, 100.0, -20.0, -50.0};
    const KernelPieces pieces = {
        .count = SHIPS,
        .vertex_count = SHIPS * SIDES,
        .moves = moves,
        .turn = turn,
        .start_us = start_us,
        .end_us = end_us,
        .leg_start_us = start_us,
        .leg_end_us = end_us,
        .leg_start_deg = leg_start_deg,
        .leg_end_deg = leg_end_deg,
        .bearing_deg = bearing_deg,
        .shape_offset = shape_offset,
        .shape = shape,
    };
    KernelScene *scene = NULL;
    KernelStatus status = kernel_scene_make(&plane, &pieces, &scene);

    /* One pair, for the whole hour. */
    const int64_t a = 0, b = 1, zero_us = 0;
    const double low_s = 0.0, high_s = 3600.0;
    const KernelPairs pairs = {.count = 1, .a = &a, .b = &b, .zero_us = &zero_us, .low_s = &low_s, .high_s = &high_s};
    const KernelQuestion question = {.separation_m = 0.0, .tolerance_m = 0.01};
    KernelContact *contacts = NULL;
    KernelWork work = {0};
    int64_t count = 0;
    if (status == KERNEL_OK) { status = kernel_contacts(scene, &pairs, &question, &contacts, &count, &work); }
    for (int64_t i = 0; status == KERNEL_OK && i < count; i++) {
        printf("%s from %.3f s to %.3f s, each to %.1e s\n", VERDICTS[contacts[i].verdict], contacts[i].start_s,
               contacts[i].end_s, contacts[i].error_s);
    }
    if (status != KERNEL_OK) {
        fprintf(stderr, "two_ships: the kernel ended with status %d (KernelStatus in kernel.h)\n", (int)status);
    }
    kernel_free(contacts);
    kernel_scene_free(scene);
    return status == KERNEL_OK ? 0 : 1;
}
