// Keeps a history near what the 3x3 pixels show now. CONSTRAINT: 0 nothing, 1 clamps to their box, 2 clips to their box,
// 3 clips to the box of mean +- GAMMA standard deviations, 4 to both boxes, towards the mean, which is in both.
//
// The text clamps to the first box before it clips to the second. But a clamp moves each channel on its own: a history whose
// hue is far off becomes one of this neighbourhood's hues, and what remains differs in brightness, which the clip then
// leaves. The way to the mean ends near the mean instead, since all channels are scaled by the one that is furthest off.

#include "neighbourhood.glsl"

#ifndef GAMMA
#define GAMMA 1.0
#endif

// Half an edge of a box counts as at least this part of the largest channel, and 1e-8: some units of the last place of a
// history of 32 bits, of which the rounding is larger than a box whose pixels agree in a channel. Without it such a history
// would be thrown back to the middle in all channels. A history of halves needs 0.0005.
#ifndef CLIP_SLACK
#define CLIP_SLACK 2e-6
#endif

// The point of the segment from the middle of the box to the history where it leaves the box; a history inside is returned
// to the bit. The last clamp takes off what rounding left outside, and for a box thinner than the slack at most the slack.
vec3 clipped(vec3 history, vec3 low, vec3 high) {
    if (clamp(history, low, high) == history) {
        return history;
    }
    vec3 largest = max(abs(low), abs(high));
    float slack = CLIP_SLACK * max(max(largest.x, largest.y), largest.z) + 1e-8;
    vec3 middle = 0.5 * (low + high), way = history - middle;
    vec3 outside = abs(way) / max(0.5 * (high - low), vec3(slack));
    return clamp(middle + way / max(max(outside.x, outside.y), max(outside.z, 1.0)), low, high);
}

// The same for a `middle` that is not in the middle of the box, but inside.
vec3 clipped_towards(vec3 middle, vec3 history, vec3 low, vec3 high) {
    if (clamp(history, low, high) == history) {
        return history;
    }
    vec3 largest = max(abs(low), abs(high));
    float slack = CLIP_SLACK * max(max(largest.x, largest.y), largest.z) + 1e-8;
    vec3 way = history - middle, room = mix(middle - low, high - middle, greaterThan(way, vec3(0.0)));
    vec3 outside = abs(way) / max(room, vec3(slack));
    return clamp(middle + way / max(max(outside.x, outside.y), max(outside.z, 1.0)), low, high);
}

#ifdef CONSTRAINT
vec3 constrained(vec3 history, Neighbourhood n) {
#if CONSTRAINT == 0
    return history;
#elif CONSTRAINT == 1
    return clamp(history, n.low, n.high);
#elif CONSTRAINT == 2
    return clipped(history, n.low, n.high);
#else
    vec3 reach = GAMMA * n.deviation, low = n.mean - reach, high = n.mean + reach;
#if CONSTRAINT == 4
    return clipped_towards(n.mean, history, max(n.low, low), min(n.high, high));
#else
    return clipped(history, low, high);
#endif
#endif
}
#endif
