/* The certified window: outside it a pair is proven apart. */
#ifndef CONFLICTDB_WINDOW_H
#define CONFLICTDB_WINDOW_H

#include "narrow/encounter.h"

/* A fraction [u, v] of a time outside which the pair is proven apart; throughout if u > v. */
typedef struct {
    double u, v;
} Share;

/* Gaps, plane metres, below which a pair may be within the margin, in contact, and deeper in contact than the margin;
 * and the fractions of a time outside which it is not. */
typedef struct {
    double near, touch, deep;
} Levels;
typedef struct {
    Share near, touch, deep;
} Shares;

/* Fractions of the time whose ends are a0, b0 and a1, b1. levels: including the deviation of vertices from their
 * chords. */
Shares window_shares(Encounter *pair, Levels levels);

/* Narrow a fraction of that time by the gap along a unit vector: outside the result the gap exceeds the level. */
Share window_share_along(const Encounter *pair, Vector axis, double level, Share share);

static inline bool is_none(Share share) { return share.u > share.v; }

#endif
