// Study bias-explorer: the part of the light that reaches a point of a plane, by the comparisons of one bias.

#define ACCESS readonly
#include "planes.glsl"

// `at` is in texels from the cell's lower left corner. The point is computed along the plane, not from the depth that
// the map's formula gives: in a renderer the two come from different places, too, and are rounded differently.
float lit_part(int number, int bias, vec2 at) {
    Plane plane = planes[number];
    vec2 d = plane.along.xy, from_middle = at - 0.5 * float(SIDE);
    precise float up = (from_middle.x * d.x + from_middle.y * d.y) / plane.tilt.x;
    precise float depth = MIDDLE + up * plane.tilt.y;
    precise float less = 0.0;
    if (bias == 1 || bias >= 3) {
        less += plane.tilt.w;
    }
    if (bias == 2 || bias == 3) {
        less += plane.along.z;
    }
    ivec2 middle = ivec2(floor(at));
    int lit = 0;
    for (int y = -RADIUS; y <= RADIUS; ++y) {
        for (int x = -RADIUS; x <= RADIUS; ++x) {
            ivec2 texel = middle + ivec2(x, y);
            precise float compared = depth - less;
            if (bias == 4) {
                vec2 step = vec2(texel) + 0.5 - at;
                compared += plane.tilt.z * (step.x * d.x + step.y * d.y);
            }
            lit += map[place_of(number, texel)] < compared ? 0 : 1;
        }
    }
    return float(lit) / float((2 * RADIUS + 1) * (2 * RADIUS + 1));
}

// Whether all that the filter reads at a point is of the bare half, or all is below the sheet.
bool is_bare(vec2 at) {
    return floor(at.x) + float(RADIUS) < 0.5 * float(SIDE);
}
bool is_below(vec2 at) {
    return floor(at.x) - float(RADIUS) >= 0.5 * float(SIDE);
}
