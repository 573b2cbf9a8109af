/* Bytes of rows, made of those of their parts. */
#include <stdbool.h>
#include <string.h>

#include "kernel.h"

/* Where the bytes of a part of row i begin, and how many they are; false where they are not within the part. */
static bool find(const KernelPart *part, int64_t i, int64_t *from, int64_t *width) {
    if (part->offset) {
        *from = part->offset[i];
        if (*from < 0 || part->offset[i + 1] < *from || part->offset[i + 1] > part->size) return false;
        *width = part->offset[i + 1] - *from;
        return true;
    }
    if (part->width < 0 || (part->width > 0 && i >= part->size / part->width)) return false;
    *from = i * part->width, *width = part->width;
    return true;
}

KernelStatus kernel_interleave(const KernelPart *parts, int64_t part_count, int64_t count, uint8_t *rows, int64_t size) {
    if (part_count < 0 || count < 0 || size < 0) return KERNEL_BAD_COUNT;
    if ((part_count > 0 && !parts) || (size > 0 && !rows)) return KERNEL_NULL;
    for (int64_t k = 0; k < part_count; k++)
        if (parts[k].size < 0 || (parts[k].size > 0 && !parts[k].data)) return KERNEL_NULL;
    int64_t done = 0;
    for (int64_t i = 0; i < count; i++) {
        for (int64_t k = 0; k < part_count; k++) {
            int64_t from, width;
            if (!find(parts + k, i, &from, &width) || width > size - done) return KERNEL_BAD_OFFSET;
            if (width > 0) memcpy(rows + done, parts[k].data + from, (size_t)width);
            done += width;
        }
    }
    return done == size ? KERNEL_OK : KERNEL_BAD_OFFSET;
}
