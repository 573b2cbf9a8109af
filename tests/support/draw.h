/* Numbers as if drawn at random, the same on every machine. `state` is set first, to any number but 0. */
#ifndef DRAW_H
#define DRAW_H

#include <stdint.h>

static uint64_t state;

static uint64_t draw(void) { /* xorshift64* */
    state ^= state >> 12, state ^= state << 25, state ^= state >> 27;
    return state * UINT64_C(2685821657736338717);
}

static int64_t below(int64_t n) { return (int64_t)(draw() % (uint64_t)n); }
static double uniform(double low, double high) { return low + (high - low) * ((double)(draw() >> 11) * 0x1p-53); }

#endif
