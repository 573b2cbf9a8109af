/* Numbers as if drawn at random, the same on every machine. `state` is set first, to any number but 0.
 *
 * With DRAWN_FROM_BYTES they are the bytes of `bytes_left`, as long as there are any: a fuzzer chooses them. */
#ifndef DRAW_H
#define DRAW_H

#include <stddef.h>
#include <stdint.h>

static uint64_t state;

static uint64_t draw(void) { /* xorshift64* */
    state ^= state >> 12, state ^= state << 25, state ^= state >> 27;
    return state * UINT64_C(2685821657736338717);
}

#ifdef DRAWN_FROM_BYTES
static const uint8_t *bytes;
static size_t bytes_left;

/* A number of so many bytes, or of random ones. */
static uint64_t taken(size_t size) {
    uint64_t found = 0;
    if (bytes_left < size) return draw() >> (64 - 8 * size);
    for (size_t i = 0; i < size; i++) found = found << 8 | *bytes++;
    bytes_left -= size;
    return found;
}

static int64_t below(int64_t n) { return (int64_t)(taken(n <= 1 << 8 ? 1 : n <= 1 << 16 ? 2 : 8) % (uint64_t)n); }
static double uniform(double low, double high) { return low + (high - low) * ((double)taken(2) * 0x1p-16); }
#else
static int64_t below(int64_t n) { return (int64_t)(draw() % (uint64_t)n); }
static double uniform(double low, double high) { return low + (high - low) * ((double)(draw() >> 11) * 0x1p-53); }
#endif

#endif
