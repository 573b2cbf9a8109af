#include "planes/earth.h"

#include <math.h>
#include <stdbool.h>

static const double RADIANS = 0x1.1df46a2529d39p-6; /* pi / 180 */
/* Difference of latitudes, radians. Above it the rounding error of psi is at most 5e-16 of the difference of psi. */
static const double LONG_WAY = 0.5;

void earth_direction(double bearing_deg, double *east, double *north) {
    double quarter = nearbyint(bearing_deg / 90.0), rest = RADIANS * (bearing_deg - 90.0 * quarter);
    double sine = sin(rest), cosine = cos(rest), turn = fmod(quarter, 4.0);
    if (turn < 0.0) turn += 4.0;
    if (turn == 0.0) *east = sine, *north = cosine;
    else if (turn == 1.0) *east = cosine, *north = -sine;
    else if (turn == 2.0) *east = -sine, *north = -cosine;
    else *east = -cosine, *north = sine;
}

/* tan chi of the tangent of a geographic latitude (Karney 2011, eqs. 7 to 9). */
static double conformal_tangent(const KernelPlane *earth, double tau) {
    double secant = hypot(1.0, tau), e = earth->eccentricity;
    double sigma = sinh(e * atanh(e * tau / secant));
    return hypot(1.0, sigma) * tau - sigma * secant;
}

/* The sum of c_j sin(2 j x) by Clenshaw's algorithm, with one sine and one cosine. */
static double sine_series(const double *coefficients, int32_t count, double x) {
    if (count == 0) return 0.0;
    double cosine = 2.0 * cos(2.0 * x), ahead = 0.0, now = 0.0;
    for (int32_t k = count - 1; k >= 0; k--) {
        double next = coefficients[k] + cosine * now - ahead;
        ahead = now, now = next;
    }
    return sin(2.0 * x) * now;
}

double earth_rectifying(const KernelPlane *earth, double latitude) {
    double chi = atan(conformal_tangent(earth, tan(latitude)));
    return chi + sine_series(earth->to_rectifying, earth->harmonics, chi);
}

/* Newton's method from the conformal to the geographic tangent. Two steps reach the last digit for WGS84 (Karney 2011);
 * the third is a reserve. */
double earth_latitude(const KernelPlane *earth, double psi) {
    double target = sinh(psi), rest = 1.0 - earth->eccentricity * earth->eccentricity, tau = target / rest;
    for (int step = 0; step < 3 && rest < 1.0; step++) {
        double now = conformal_tangent(earth, tau);
        tau += (target - now) / hypot(1.0, now) * (1.0 + rest * tau * tau) / (rest * hypot(1.0, tau));
    }
    return atan(tau);
}

double earth_conformal(const KernelPlane *earth, double mu) {
    return mu + sine_series(earth->to_conformal, earth->harmonics, mu);
}

double earth_isometric(const KernelPlane *earth, double mu) { return asinh(tan(earth_conformal(earth, mu))); }

double earth_slope(const KernelPlane *earth, double mu) {
    /* d chi / d mu, with cosines of multiples by recurrence. */
    double value = 1.0, turn = 2.0 * cos(2.0 * mu), before = 1.0, cosine = 0.5 * turn;
    for (int j = 1; j <= earth->harmonics; j++) {
        value += 2.0 * j * earth->to_conformal[j - 1] * cosine;
        double next = turn * cosine - before;
        before = cosine, cosine = next;
    }
    return value / cos(earth_conformal(earth, mu));
}

static double sinc(double x) { return x == 0.0 ? 1.0 : sin(x) / x; }

/* (chi2 - chi1) / (mu2 - mu1): a divided difference of sin(2 j mu) is
 * 2 cos(j (mu1 + mu2)) sin(j (mu2 - mu1)) / (mu2 - mu1). */
static double conformal_stretch(const KernelPlane *earth, double mu1, double mu2) {
    if (earth->harmonics == 0) return 1.0;
    double total = mu1 + mu2, difference = mu2 - mu1, ratio = 1.0;
    double turn = 2.0 * cos(total), swing = 2.0 * cos(difference);
    double cosine = 0.5 * turn, cosine_before = 1.0, spread = sinc(difference), spread_before = 0.0;
    for (int j = 0; j < earth->harmonics; j++) {
        ratio += 2.0 * earth->to_conformal[j] * cosine * spread;
        double next = turn * cosine - cosine_before;
        cosine_before = cosine, cosine = next;
        next = swing * spread - spread_before;
        spread_before = spread, spread = next;
    }
    return ratio;
}

double earth_stretch(const KernelPlane *earth, double mu1, double mu2) {
    double chi1 = earth_conformal(earth, mu1), chi2 = earth_conformal(earth, mu2);
    /* Over long distances nothing cancels, while z approaches 1 from near one pole to near the other. */
    if (fabs(mu2 - mu1) > LONG_WAY) return (asinh(tan(chi2)) - asinh(tan(chi1))) / (mu2 - mu1);
    double ratio = conformal_stretch(earth, mu1, mu2), half = 0.5 * ratio * (mu2 - mu1);
    double secant = 1.0 / cos(0.5 * (chi1 + chi2));
    double z = sinc(half) * half * secant;
    return ratio * (z == 0.0 ? 1.0 : atanh(z) / z) * sinc(half) * secant;
}

/* chi'(mu + d) = sum of r_k d^k, k < terms. */
static void conformal_rate(const KernelPlane *earth, double mu, int64_t terms, double rate[EARTH_TERMS]) {
    double cosine1 = cos(2.0 * mu), sine1 = sin(2.0 * mu), cosine = cosine1, sine = sine1;
    for (int64_t k = 0; k < terms; k++) rate[k] = k == 0;
    for (int j = 1; j <= earth->harmonics; j++) {
        double factor = 2.0 * j * earth->to_conformal[j - 1], turned[4] = {cosine, -sine, -cosine, sine};
        for (int64_t k = 0; k < terms; k++) {
            rate[k] += factor * turned[k % 4];
            factor *= 2.0 * j / (k + 1);
        }
        double next = cosine * cosine1 - sine * sine1;
        sine = sine * cosine1 + cosine * sine1, cosine = next;
    }
}

/* psi' = sec(chi) chi', (sec chi)' = tan(chi) psi' and (tan chi)' = sec(chi) psi': each coefficient of the three power
 * series follows from the previous ones. */
void earth_series(const KernelPlane *earth, double mu, int64_t terms, double series[EARTH_TERMS]) {
    REQUIRE(terms > 0 && terms <= EARTH_TERMS);
    double rate[EARTH_TERMS], slope[EARTH_TERMS], secant[EARTH_TERMS + 1], tangent[EARTH_TERMS + 1];
    tangent[0] = tan(earth_conformal(earth, mu)), secant[0] = sqrt(1.0 + tangent[0] * tangent[0]);
    conformal_rate(earth, mu, terms, rate);
    for (int64_t k = 0; k < terms; k++) {
        slope[k] = 0.0;
        for (int64_t i = 0; i <= k; i++) slope[k] += secant[i] * rate[k - i];
        double to_secant = 0.0, to_tangent = 0.0;
        for (int64_t i = 0; i <= k; i++) to_secant += slope[i] * tangent[k - i], to_tangent += slope[i] * secant[k - i];
        series[k] = slope[k] / (k + 1);
        secant[k + 1] = to_secant / (k + 1), tangent[k + 1] = to_tangent / (k + 1);
    }
}
