// Weights of the current colour and the history: the result is (current * w.x + history * w.y) / (w.x + w.y).
// `share` is the part of the current colour without any filter: 0.1 as a rule, 1 without a history. WEIGHT:
//
// 0  (share, 1 - share).
// 1  by contrast in time: the history weighs more where neighbours differ, from 0.25 up to 0.85.
// 2  by inverse luminance: both weights of 0 are divided by 1 + luminance, so that one bright sample does not flicker.
// 3  by difference of luminance: the history weighs HISTORY_MOST where both are equal, and less, down to HISTORY_LEAST, the
//    more they differ (Pedersen 2016, "Temporal reprojection anti-aliasing in INSIDE").
//
// In 1 and 3 a share of at most 0.1 leaves the history's weight h as it is, and above that h falls in proportion to
// 1 - share, to 0 at 1: a young history, with a share of 1/n after n frames, then counts about as much as its n - 1 frames.
// Colours are finite. A luminance below 0 counts as 0.

#include "neighbourhood.glsl"
#include "luminance.glsl"

#ifndef HISTORY_LEAST
#define HISTORY_LEAST 0.88
#endif
#ifndef HISTORY_MOST
#define HISTORY_MOST 0.97
#endif

float weight_luminance(vec3 color) {
#ifdef YCOCG
    return max(color.x, 0.0);
#else
    return max(luminance(color), 0.0);
#endif
}

vec2 shared_out(float history_weight, float share) {
    float weight = history_weight * min((1.0 - share) / 0.9, 1.0);
    return vec2(1.0 - weight, weight);
}

#ifdef WEIGHT
vec2 weights(vec3 current, vec3 history, Neighbourhood n, float share) {
#if WEIGHT == 0
    return vec2(share, 1.0 - share);
#elif WEIGHT == 1
    float range = weight_luminance(n.high) - weight_luminance(n.low);
    float contrast = clamp(range / max(weight_luminance(current), 1e-4), 0.0, 1.0);  // a black pixel divides by 1e-4
    return shared_out(mix(0.25, 0.85, contrast), share);
#elif WEIGHT == 2
    return vec2(share, 1.0 - share) / (1.0 + vec2(weight_luminance(current), weight_luminance(history)));
#else
    float now = weight_luminance(current), before = weight_luminance(history);
    float difference = abs(now - before) / max(max(now, before), 0.2);  // below 0.2 differences matter less
    float likeness = (1.0 - difference) * (1.0 - difference);
    return shared_out(mix(HISTORY_LEAST, HISTORY_MOST, likeness), share);
#endif
}
#endif
