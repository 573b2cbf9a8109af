/* The certified window: outside of which part of a time a pair is proven not to be in contact. */
#ifndef CONFLICTDB_WINDOW_H
#define CONFLICTDB_WINDOW_H

#include "encounter.h"

/* The share of a time outside of which the pair is apart: u > v if it is throughout. */
typedef struct {
    double u, v;
} Share;

/* Below which gaps, plane metres, a pair may be within the margin, in contact, and in contact beyond the margin; and the
 * shares of a time outside of which it is not. */
typedef struct {
    double near, touch, deep;
} Levels;
typedef struct {
    Share near, touch, deep;
} Shares;

/* Shares of the time at whose ends the pair's a0, b0 and a1, b1 are. levels: with what vertices leave their chords. */
Shares window_shares(Encounter *pair, Levels levels);

/* What a unit vector leaves of a share of that time, outside of which the pair is no nearer than a level. */
Share window_share_along(const Encounter *pair, Vector axis, double level, Share share);

static inline bool is_none(Share share) { return share.u > share.v; }

#endif
