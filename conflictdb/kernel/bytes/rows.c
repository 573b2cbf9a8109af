/* Concatenate rows of bytes from their parts, and compute digests of them. */
#include <stdbool.h>
#include <string.h>

#include "kernel.h"

/* The bytes of row i of a part; false if they exceed the part. */
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

static KernelStatus check_parts(const KernelPart *parts, int64_t part_count, int64_t count) {
    if (part_count < 0 || count < 0) return KERNEL_BAD_COUNT;
    if (part_count > 0 && !parts) return KERNEL_NULL;
    for (int64_t k = 0; k < part_count; k++)
        if (parts[k].size < 0 || (parts[k].size > 0 && !parts[k].data)) return KERNEL_NULL;
    return KERNEL_OK;
}

KernelStatus kernel_interleave(const KernelPart *parts, int64_t part_count, int64_t count, uint8_t *rows, int64_t size) {
    KernelStatus status = size < 0 ? KERNEL_BAD_COUNT : check_parts(parts, part_count, count);
    if (status != KERNEL_OK) return status;
    if (size > 0 && !rows) return KERNEL_NULL;
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

/* SipHash-2-4 (Aumasson and Bernstein 2012, doi:10.1007/978-3-642-34931-7_28): four state words, and the bytes of an
 * incomplete word. */
typedef struct {
    uint64_t v[4], word;
    uint64_t length;
} Sip;

static uint64_t turned(uint64_t word, int by) { return (word << by) | (word >> (64 - by)); }

static void sip_rounds(Sip *sip, int count) {
    uint64_t a = sip->v[0], b = sip->v[1], c = sip->v[2], d = sip->v[3];
    while (count-- > 0) {
        a += b, b = turned(b, 13) ^ a, a = turned(a, 32);
        c += d, d = turned(d, 16) ^ c;
        a += d, d = turned(d, 21) ^ a;
        c += b, b = turned(b, 17) ^ c, c = turned(c, 32);
    }
    sip->v[0] = a, sip->v[1] = b, sip->v[2] = c, sip->v[3] = d;
}

static void sip_word(Sip *sip, uint64_t word) {
    sip->v[3] ^= word;
    sip_rounds(sip, 2);
    sip->v[0] ^= word;
}

static Sip sip_begin(const uint64_t key[2]) {
    return (Sip){
        {key[0] ^ 0x736f6d6570736575, key[1] ^ 0x646f72616e646f6d, key[0] ^ 0x6c7967656e657261, key[1] ^ 0x7465646279746573},
        0,
        0};
}

/* The first `count` of 8 bytes as a little-endian word. */
static uint64_t word_of(const uint8_t *bytes, int count) {
    uint64_t word = 0;
    for (int i = 0; i < count; i++) word |= (uint64_t)bytes[i] << 8 * i;
    return word;
}

static void sip_add(Sip *sip, const uint8_t *bytes, int64_t count) {
    int held = 8 * (int)(sip->length % 8);
    sip->length += (uint64_t)count;
    for (; count >= 8; bytes += 8, count -= 8) {
        uint64_t word = word_of(bytes, 8);
        sip_word(sip, sip->word | word << held);
        sip->word = held > 0 ? word >> (64 - held) : 0;
    }
    uint64_t word = word_of(bytes, (int)count);
    int more = 8 * (int)count;
    sip->word |= word << held;
    if (held + more < 64) return;
    sip_word(sip, sip->word);
    sip->word = held > 0 ? word >> (64 - held) : 0;
}

static uint64_t sip_end(Sip *sip) {
    sip_word(sip, sip->word | sip->length << 56);
    sip->v[2] ^= 0xff;
    sip_rounds(sip, 4);
    return sip->v[0] ^ sip->v[1] ^ sip->v[2] ^ sip->v[3];
}

KernelStatus kernel_digests(const KernelPart *parts, int64_t part_count, int64_t count, const uint64_t *key, uint64_t *digest) {
    KernelStatus status = check_parts(parts, part_count, count);
    if (status != KERNEL_OK) return status;
    if (!key || (count > 0 && !digest)) return KERNEL_NULL;
    for (int64_t i = 0; i < count; i++) {
        Sip sip = sip_begin(key);
        for (int64_t k = 0; k < part_count; k++) {
            int64_t from, width;
            if (!find(parts + k, i, &from, &width)) return KERNEL_BAD_OFFSET;
            if (width > 0) sip_add(&sip, parts[k].data + from, width);
        }
        digest[i] = sip_end(&sip);
    }
    return KERNEL_OK;
}
