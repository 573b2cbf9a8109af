/* Rings of polygons from well-known binary (OGC 06-103r4, 8.2). */
#include <stdbool.h>
#include <string.h>

#include "kernel.h"

enum { POLYGON = 3, MULTIPOLYGON = 6, HEAD = 5, COUNT = 4, VERTEX = 16 };

/* The unread bytes of a shape. */
typedef struct {
    const uint8_t *next, *end;
} Reader;

static uint64_t read_number(Reader *reader, int bytes) {
    uint64_t number = 0;
    for (int i = 0; i < bytes; i++) number |= (uint64_t)reader->next[i] << (8 * i);
    reader->next += bytes;
    return number;
}

/* Read byte order (little-endian), type, and count of what follows; false if invalid. */
static bool read_head(Reader *reader, uint64_t *type, uint64_t *count) {
    if (reader->end - reader->next < HEAD + COUNT || read_number(reader, 1) != 1) return false;
    *type = read_number(reader, 4), *count = read_number(reader, COUNT);
    return true;
}

/* Read the ring of a polygon, after its head; false if it is truncated or does not fit. */
static bool read_ring(Reader *reader, double *xy, int64_t *vertices, int64_t room) {
    if (reader->end - reader->next < COUNT) return false;
    int64_t count = (int64_t)read_number(reader, COUNT);
    if (count > (reader->end - reader->next) / VERTEX || count > room - *vertices) return false;
    for (int64_t i = 2 * *vertices; i < 2 * (*vertices + count); i++) {
        uint64_t bits = read_number(reader, 8);
        memcpy(xy + i, &bits, sizeof bits);
    }
    *vertices += count;
    return true;
}

KernelStatus kernel_wkb_rings(const uint8_t *wkb, int64_t size, const int64_t *offset, int64_t count, double *xy,
                              int64_t vertex_room, int64_t *ring_offset, int64_t rings) {
    if (size < 0 || count < 0 || vertex_room < 0 || rings < 0) return KERNEL_BAD_COUNT;
    if (!offset || !ring_offset || (size > 0 && !wkb) || (vertex_room > 0 && !xy)) return KERNEL_NULL;
    int64_t vertices = 0, ring = 0;
    ring_offset[0] = 0;
    for (int64_t i = 0; i < count; i++) {
        if (offset[i] < 0 || offset[i + 1] < offset[i] || offset[i + 1] > size) return KERNEL_BAD_OFFSET;
        Reader reader = {wkb + offset[i], wkb + offset[i + 1]};
        uint64_t type, parts = 1, of_ring;
        if (!read_head(&reader, &type, &of_ring) || (type != POLYGON && type != MULTIPOLYGON)) return KERNEL_BAD_COUNT;
        if (type == MULTIPOLYGON) parts = of_ring;
        for (uint64_t part = 0; part < parts; part++) {
            if (type == MULTIPOLYGON) {
                uint64_t of_part;
                if (!read_head(&reader, &of_part, &of_ring) || of_part != POLYGON) return KERNEL_BAD_COUNT;
            }
            if (of_ring != 1 || ring == rings || !read_ring(&reader, xy, &vertices, vertex_room)) return KERNEL_BAD_COUNT;
            ring_offset[++ring] = vertices;
        }
    }
    return ring == rings ? KERNEL_OK : KERNEL_BAD_COUNT;
}
