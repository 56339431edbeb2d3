// Normals as the G-buffer stores them: NORMAL_OCTAHEDRAL in one whole number, NORMAL_CODED in channels of ten bits, else as
// they are. What is unlit has NO_NORMAL.
//
// Channels from 0 to 1 of ten bits: 512 of 1023 stands for 0, so that what is upright comes back as it was.

#include "octahedral.glsl"

vec3 coded_normal(vec3 n) {
    return (n * 511.0 + 512.0) / 1023.0;
}

vec3 decoded_normal(vec3 code) {
    return (code * 1023.0 - 512.0) / 511.0;
}

#ifdef NORMAL_OCTAHEDRAL
#define NORMAL_SAMPLER usampler2D
const uint NO_NORMAL = 0x80008000u;  // -32768 twice, which no code has

uint kept_normal(vec3 n) { return packSnorm2x16(octahedral_from_unit(n)); }
#else
#define NORMAL_SAMPLER sampler2D
const vec4 NO_NORMAL = vec4(0.0);

vec4 kept_normal(vec3 n) {
#ifdef NORMAL_CODED
    return vec4(coded_normal(n), 0.0);
#else
    return vec4(n, 0.0);
#endif
}
#endif

// The normal of a pixel, about unit length, in the world; (0, 0, 0) where there is none.
vec3 found_normal(NORMAL_SAMPLER normals, ivec2 pixel) {
#ifdef NORMAL_OCTAHEDRAL
    uint code = texelFetch(normals, pixel, 0).r;
    return code == NO_NORMAL ? vec3(0.0) : unit_from_octahedral(unpackSnorm2x16(code));
#else
    vec3 stored = texelFetch(normals, pixel, 0).xyz;
#ifdef NORMAL_CODED
    return stored == vec3(0.0) ? vec3(0.0) : decoded_normal(stored);
#else
    return stored;
#endif
#endif
}
