#include "earth.h"

#include <math.h>
#include <stdbool.h>

static const double RADIANS = 0x1.1df46a2529d39p-6; /* pi / 180 */

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

double earth_rectifying(const KernelPlane *earth, double latitude) {
    double chi = atan(conformal_tangent(earth, tan(latitude))), mu = chi;
    for (int j = 1; j <= earth->harmonics; j++) mu += earth->to_rectifying[j - 1] * sin(2 * j * chi);
    return mu;
}

/* Newton's method from the conformal to the geographic tangent: two steps reach the last digit for WGS84 (Karney
 * 2011), and one is to spare. */
double earth_latitude(const KernelPlane *earth, double psi) {
    double target = sinh(psi), rest = 1.0 - earth->eccentricity * earth->eccentricity, tau = target / rest;
    for (int step = 0; step < 3 && rest < 1.0; step++) {
        double now = conformal_tangent(earth, tau);
        tau += (target - now) / hypot(1.0, now) * (1.0 + rest * tau * tau) / (rest * hypot(1.0, tau));
    }
    return atan(tau);
}

double earth_conformal(const KernelPlane *earth, double mu) {
    if (earth->harmonics == 0) return mu;
    /* Clenshaw: one sine and one cosine serve the whole series. */
    double cosine = 2.0 * cos(2.0 * mu), ahead = 0.0, now = 0.0;
    for (int k = earth->harmonics - 1; k >= 0; k--) {
        double next = earth->to_conformal[k] + cosine * now - ahead;
        ahead = now, now = next;
    }
    return mu + sin(2.0 * mu) * now;
}

double earth_isometric(const KernelPlane *earth, double mu) { return asinh(tan(earth_conformal(earth, mu))); }

double earth_slope(const KernelPlane *earth, double mu) {
    /* d chi / d mu: the cosines of multiples by their recurrence. */
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
    double ratio = conformal_stretch(earth, mu1, mu2), half = 0.5 * ratio * (mu2 - mu1);
    double secant = 1.0 / cos(0.5 * (earth_conformal(earth, mu1) + earth_conformal(earth, mu2)));
    double z = sinc(half) * half * secant;
    return ratio * (z == 0.0 ? 1.0 : atanh(z) / z) * sinc(half) * secant;
}

/* The sphere's series: g_k = psi^(k) / k! with psi' = sec, and (sec P(tan))' = sec (tan P + (1 + tan^2) P'). P is
 * evaluated with its coefficients, integers below 2^53. */
static void sphere_series(double chi, double series[EARTH_TERMS]) {
    double polynomial[EARTH_TERMS + 1] = {1.0}, factorial = 1.0, tangent = tan(chi);
    double secant = sqrt(1.0 + tangent * tangent), square = tangent * tangent;
    for (int k = 1; k <= EARTH_TERMS; k++) {
        factorial *= k;
        /* Only every second power is there: those of the parity of k - 1, up to it. */
        double value = polynomial[k - 1];
        for (int power = k - 3; power >= 0; power -= 2) value = value * square + polynomial[power];
        series[k - 1] = value / factorial * secant * (k % 2 ? 1.0 : tangent);
        double next[EARTH_TERMS + 1] = {0.0};
        for (int power = 0; power < k; power++) {
            next[power + 1] += (power + 1) * polynomial[power];
            if (power > 0) next[power - 1] += power * polynomial[power];
        }
        for (int power = 0; power <= k; power++) polynomial[power] = next[power];
    }
}

/* c_1 to c_12 with chi(mu + d) = chi(mu) + sum of c_k d^k. */
static void conformal_series(const KernelPlane *earth, double mu, double series[EARTH_TERMS]) {
    double cosine1 = cos(2.0 * mu), sine1 = sin(2.0 * mu), cosine = cosine1, sine = sine1;
    for (int k = 0; k < EARTH_TERMS; k++) series[k] = k == 0;
    for (int j = 1; j <= earth->harmonics; j++) {
        double factor = earth->to_conformal[j - 1], turned[4] = {cosine, -sine, -cosine, sine};
        for (int k = 0; k < EARTH_TERMS; k++) {
            factor *= 2.0 * j / (k + 1);
            series[k] += factor * turned[k % 4];
        }
        double next = cosine * cosine1 - sine * sine1;
        sine = sine * cosine1 + cosine * sine1, cosine = next;
    }
}

void earth_series(const KernelPlane *earth, double mu, double series[EARTH_TERMS]) {
    double sphere[EARTH_TERMS], inner[EARTH_TERMS];
    sphere_series(earth_conformal(earth, mu), sphere);
    if (earth->harmonics == 0) {
        for (int k = 0; k < EARTH_TERMS; k++) series[k] = sphere[k];
        return;
    }
    /* Horner's rule on truncated power series: found = (found + g_m) inner, from the highest power down. */
    conformal_series(earth, mu, inner);
    double found[EARTH_TERMS] = {0.0};
    for (int m = EARTH_TERMS - 1; m >= 0; m--) {
        int keep = EARTH_TERMS - m;
        double product[EARTH_TERMS];
        for (int k = 0; k < keep; k++) product[k] = sphere[m] * inner[k];
        for (int i = 0; i < keep - 1; i++)
            for (int k = 0; k < keep - 1 - i; k++) product[i + 1 + k] += found[i] * inner[k];
        for (int k = 0; k < keep; k++) found[k] = product[k];
    }
    for (int k = 0; k < EARTH_TERMS; k++) series[k] = found[k];
}
