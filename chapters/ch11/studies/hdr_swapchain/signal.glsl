// What a display is sent, from light: pure functions. NITS are candelas per square metre. REC_2020_FROM_709 and
// REC_709_FROM_2020 are the elements of matrices, by columns, which gamut.py derives from the primaries.

#include "finite.glsl"

// --- SMPTE ST 2084, the perceptual quantizer (PQ) ---

const float PQ_PEAK = 10000.0;  // the luminance of code 1, in nits
const float PQ_M1 = 2610.0 / 16384.0;
const float PQ_M2 = 2523.0 / 32.0;
const float PQ_C1 = 107.0 / 128.0;
const float PQ_C2 = 2413.0 / 128.0;
const float PQ_C3 = 2392.0 / 128.0;

// The code, 0 to 1, of a luminance; below 0 as 0, above 10,000 as 10,000.
// The standard prints ((c1 + c2 p) / (1 + c3 p))^m2 with p = y^m1. The ratio lies between 0.836 and 1, and the power m2 = 79
// multiplies each rounding of it by 79. Since c1 = 1 + c3 - c2, the ratio is 1 - d with d = (c2 - c3)(1 - p) / (1 + c3 p).
// ln(1 - d) = -2 atanh(d / (2 - d)) is a series of positive terms, so that its relative error stays at a few roundings.
float pq_from_nits(float nits) {
    float p = pow(clamp(nits / PQ_PEAK, 0.0, 1.0), PQ_M1);
    float d = (PQ_C2 - PQ_C3) * (1.0 - p) / (1.0 + PQ_C3 * p);
    float z = d / (2.0 - d), square = z * z;  // z is at most 0.09, so the terms left out are below 1e-7 of the sum
    float log_of_ratio = -2.0 * z * (1.0 + square * (1.0 / 3.0 + square / 5.0));
    return exp(PQ_M2 * log_of_ratio);
}

// The luminance of a code, ST 2084 equation 5.2.
float nits_from_pq(float code) {
    float root = pow(clamp(code, 0.0, 1.0), 1.0 / PQ_M2);
    float y = max(root - PQ_C1, 0.0) / (PQ_C2 - PQ_C3 * root);
    return PQ_PEAK * pow(y, 1.0 / PQ_M1);
}

vec3 pq_from_nits(vec3 nits) {
    return vec3(pq_from_nits(nits.r), pq_from_nits(nits.g), pq_from_nits(nits.b));
}

vec3 nits_from_pq(vec3 codes) {
    return vec3(nits_from_pq(codes.r), nits_from_pq(codes.g), nits_from_pq(codes.b));
}

// --- gamut and scale ---

vec3 rec2020_from_rec709(vec3 light) { return mat3(REC_2020_FROM_709) * light; }

vec3 rec709_from_rec2020(vec3 light) { return mat3(REC_709_FROM_2020) * light; }

// Windows' scRGB: linear light in primaries of Rec. 709, where 1.0 is 80 nits.
const float SCRGB_WHITE = 80.0;

vec3 scrgb_from_nits(vec3 nits) { return nits / SCRGB_WHITE; }

// --- the range of the display ---

// Luminance as it is up to `knee`, and above it a hyperbola with the same slope there whose limit is `peak`:
// peak - r^2 / (nits - knee + r) with r = peak - knee. It rises everywhere and reaches `peak` at infinity.
float roll_off(float nits, float knee, float peak) {
    if (nits <= knee) {
        return nits;
    }
    float room = peak - knee;
    // Rounding may leave the formula a little outside of what it bends between.
    return clamp(peak - room * (room / (nits - knee + room)), knee, peak);
}

// The nits of the display for scene light, where 1.0 is `paper_white`. The largest channel is rolled off and the others
// keep their ratio to it, so hues stay. NaN is black, and what is negative is 0: no display shows it.
vec3 displayed_nits(vec3 light, float paper_white, float knee, float peak) {
    vec3 nits = finite_color(light) * paper_white;
    float largest = max(nits.r, max(nits.g, nits.b));
    if (largest <= knee) {
        return nits;
    }
    return nits * (roll_off(largest, knee, peak) / largest);
}
