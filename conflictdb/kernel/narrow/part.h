/* Convex parts of the plane of two times: a polygon of pairs (u, v), u a time of one piece and v a time of another. */
#ifndef CONFLICTDB_PART_H
#define CONFLICTDB_PART_H

/* Most corners of a part. Fewer: parts stay larger than the half-planes leave them, and bounds are looser. */
enum { PART_CORNERS = 96 };

typedef struct {
    double u, v;
} Times;

typedef struct {
    int count;
    Times corner[PART_CORNERS];
} Part;

/* The rectangle [u0, u1] x [v0, v1]. */
Part part_of(double u0, double u1, double v0, double v1);

/* Keep what has a u + b v + c <= 0. A part without room for a further corner stays as it is. */
void part_cut(Part *part, double a, double b, double c);

/* The mean of the corners. */
Times part_middle(const Part *part);

#endif
