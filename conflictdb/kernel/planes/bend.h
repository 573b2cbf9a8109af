/* How paths bend along a direction: bounds of second derivatives, as docs/reference/proof.md states them. */
#ifndef CONFLICTDB_BEND_H
#define CONFLICTDB_BEND_H

#include "planes/motion.h"

typedef struct {
    double low, high;
} Range;

/* Bounds of the second derivative of all vertices along a vector during [t0, t1], plane m/s^2. */
Range mover_bend(const Mover *mover, Vector along, double t0, double t1);

#endif
