// Keeps a history near what the 3x3 pixels show now. CONSTRAINT: 0 nothing, 1 clamps to their box, 2 clips to their box,
// 3 clips to the box of mean +- GAMMA standard deviations, 4 clamps to their box and then clips as 3.

#include "neighbourhood.glsl"

#ifndef GAMMA
#define GAMMA 1.0
#endif

// The point of the segment from the middle of the box to the history where it leaves the box; a history inside is returned
// to the bit. An edge below 2e-8 counts as 2e-8 in the quotient, so that nothing is divided by 0. The last clamp takes
// off what rounding left outside the box, and for such a thin box those 1e-8.
vec3 clipped(vec3 history, vec3 low, vec3 high) {
    if (clamp(history, low, high) == history) {
        return history;
    }
    vec3 middle = 0.5 * (low + high), half_size = max(0.5 * (high - low), vec3(1e-8)), way = history - middle;
    vec3 outside = abs(way) / half_size;
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
