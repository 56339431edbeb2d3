// Keeps a history near what the 3x3 pixels show now. CONSTRAINT: 0 nothing, 1 clamps to their box, 2 clips to their box,
// 3 clips to the box of mean +- GAMMA standard deviations, 4 clamps to their box and then clips as 3.

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

#ifdef CONSTRAINT
vec3 constrained(vec3 history, Neighbourhood n) {
#if CONSTRAINT == 0
    return history;
#elif CONSTRAINT == 1
    return clamp(history, n.low, n.high);
#elif CONSTRAINT == 2
    return clipped(history, n.low, n.high);
#else
#if CONSTRAINT == 4
    history = clamp(history, n.low, n.high);
#endif
    vec3 reach = GAMMA * n.deviation;
    return clipped(history, n.mean - reach, n.mean + reach);
#endif
}
#endif
