/* Latitudes and rhumb lines on the sphere and on an ellipsoid, with divided differences (as conflictdb.earth.geodesy).
 *
 * Radians. Rectifying latitude mu: proportional to distance along the meridian. Conformal latitude chi: the latitude on
 * the sphere with the same Mercator plane. psi = asinh(tan chi): the Mercator ordinate over the equatorial radius.
 *
 * C. F. F. Karney, "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy 85 (2011),
 * doi:10.1007/s00190-011-0445-3; "The area of rhumb polygons", Stud. Geophys. Geod. 68 (2024),
 * doi:10.1007/s11200-024-0709-z, section 3 (divided differences).
 */
#ifndef CONFLICTDB_EARTH_H
#define CONFLICTDB_EARTH_H

#include <math.h>

#include "kernel.h"
#include "require.h"

/* Terms of the longest power series of psi. */
enum { EARTH_TERMS = 16 };

static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }

/* Lower bound on a function between two places where it is known. drop: how far it may sag below its chord in the
 * middle, M w^2 / 8, with M a bound on its second derivative and w the width. The bound is the minimum of the parabola
 * with that second derivative: inside if the chord rises by less than 4 drop, else at an end. */
static inline double least_on_chord(double first, double last, double drop) {
    double rise = fabs(last - first);
    if (rise < 4.0 * drop) return 0.5 * (first + last) - drop - rise * rise / (16.0 * drop);
    return least(first, last);
}

/* The east and north components of a bearing, exact at multiples of 90 degrees. */
void earth_direction(double bearing_deg, double *east, double *north);

/* mu of a geographic latitude. */
double earth_rectifying(const KernelPlane *earth, double latitude);

/* chi of mu. */
double earth_conformal(const KernelPlane *earth, double mu);

/* The geographic latitude of an isometric one. */
double earth_latitude(const KernelPlane *earth, double psi);

/* psi of mu. */
double earth_isometric(const KernelPlane *earth, double mu);

/* d psi / d mu. */
double earth_slope(const KernelPlane *earth, double mu);

/* (psi2 - psi1) / (mu2 - mu1), computed without cancellation, also for mu1 = mu2. */
double earth_stretch(const KernelPlane *earth, double mu1, double mu2);

/* Coefficients g_1 to g_terms with psi(mu + d) = psi(mu) + sum of g_k d^k; terms is at most EARTH_TERMS. */
void earth_series(const KernelPlane *earth, double mu, int64_t terms, double series[EARTH_TERMS]);

/* Radius of the conformal sphere, metres, at sin(chi)^2. */
static inline double earth_conformal_radius(const KernelPlane *earth, double sine2) {
    double value = earth->conformal_radius[KERNEL_RADII - 1];
    for (int k = KERNEL_RADII - 2; k >= 0; k--) value = value * sine2 + earth->conformal_radius[k];
    return value;
}

#endif
