// What a picture needs of shadow maps, reported to the CPU (residency.py): for each lamp a resolution as the bits of a
// float, whose order is that of integers; then a bit for each tile of the table, those of lamps at the highest level.
//
// Maxima and unions of integers do not depend on the order of invocations.

#define FIRST_LAMP shadow_places[0].x
#define SUN_STRIDE shadow_places[0].y
#define SUN_SIDE shadow_places[0].z
#define LAMPS shadow_places[0].w
#define LAMP_SIDE shadow_places[1].x
#define LAMP_WORD shadow_places[1].y
const float PI = 3.14159265;

#ifndef NEEDS_BLOCK
#define NEEDS_BLOCK 4
#endif
layout(BIND(1, NEEDS_BINDING, NEEDS_BLOCK), std430) buffer Needs_ { uint needs[]; };

uint lamp_of(int face) { return uint(face - FIRST_LAMP) / (2u * uint(SHADOW_COARSE)); }

void need_resolution(uint lamp, float texels) {
    uint code = floatBitsToUint(max(texels, 1.0));
    if (needs[lamp] < code) {
        atomicMax(needs[lamp], code);
    }
}

// The length of a pixel at a depth ahead of the eye, metres.
float pixel_at(float ahead) {
    vec4 one = frame.view_from_clip * vec4(2.0 * frame.size.z, 0.0, 0.5, 1.0);
    vec4 zero = frame.view_from_clip * vec4(0.0, 0.0, 0.5, 1.0);
    float width = abs(one.x / one.w - zero.x / zero.w);
    return frame.orthographic != 0u ? width : width * ahead / max(-one.z / one.w, 1e-30);
}

// The tiles between two corners of a face, in parts of its side.
void need_tiles(int face, vec2 low, vec2 high) {
    bool of_sun = face < FIRST_LAMP;
    int side = of_sun ? SUN_SIDE : LAMP_SIDE;
    uint first = uint(of_sun ? (face / SUN_STRIDE * (SUN_STRIDE - 1) + face % SUN_STRIDE) * side * side
        : LAMP_WORD + (int(lamp_of(face)) * SHADOW_COARSE + (face - FIRST_LAMP) % SHADOW_COARSE) * side * side);
    if (any(lessThan(high, vec2(0.0))) || any(greaterThan(low, vec2(1.0)))) {
        return;
    }
    ivec2 from = ivec2(clamp(low, 0.0, 1.0) * float(side)), to = ivec2(clamp(high, 0.0, 1.0) * float(side));
    to = min(to, ivec2(side - 1));
    for (int y = min(from.y, side - 1); y <= to.y; ++y) {
        for (int x = min(from.x, side - 1); x <= to.x; ++x) {
            uint number = first + uint(y * side + x), bit = 1u << (number & 31u), word = uint(LAMPS) + (number >> 5);
            if ((needs[word] & bit) == 0u) {
                atomicOr(needs[word], bit);
            }
        }
    }
}
