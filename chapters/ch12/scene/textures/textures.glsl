// Textures by number. A material's record says which texture each role samples, and nothing is bound per material.
//
// BINDLESS: the number is a slot of one array that holds all textures. One indirect draw covers many objects, so the
// number may differ between invocations that run together; `nonuniformEXT` tells the compiler not to rely on one value.
//
// ARRAYS: without descriptor indexing, textures of one size, format and sampler are layers of an array texture. The number
// holds the array in its low byte and the layer above. A sampler may then only be indexed by what is the same for all
// invocations, such as the counter of a loop of fixed length; the array is chosen by a comparison inside it. `arrays` has
// the bits of those that may hold it, known to the compiler, which leaves out what it need not fetch.

#if defined(MIP_BIAS) && !defined(COMPUTED)  // added to the level that the footprint of a pixel asks for
#define BIAS , MIP_BIAS
#else
#define BIAS
#endif

#ifdef BINDLESS
#include "bindless.glsl"

vec4 sample_texture(uint map, uint arrays, vec2 uv) {
    return texture(textures_2d[nonuniformEXT(map)], uv BIAS);
}

vec4 sample_finest(uint map, uint arrays, vec2 uv) {
    return textureLod(textures_2d[nonuniformEXT(map)], uv, 0.0);
}

#ifndef COMPUTED  // a kernel has no differences between fragments
float sampled_level(uint map, uint arrays, vec2 uv) {
    return textureQueryLod(textures_2d[nonuniformEXT(map)], uv).x;
}
#endif
#else
layout(BIND(2, 0, 3)) uniform sampler2DArray texture_arrays[ARRAYS];

vec4 sample_texture(uint map, uint arrays, vec2 uv) {
    vec4 texel = vec4(0.0);
    for (uint i = 0u; i < ARRAYS; ++i) {
        if ((arrays >> i & 1u) != 0u && i == (map & 255u)) {
            texel = texture(texture_arrays[i], vec3(uv, float(map >> 8)) BIAS);
        }
    }
    return texel;
}

vec4 sample_finest(uint map, uint arrays, vec2 uv) {
    vec4 texel = vec4(0.0);
    for (uint i = 0u; i < ARRAYS; ++i) {
        if ((arrays >> i & 1u) != 0u && i == (map & 255u)) {
            texel = textureLod(texture_arrays[i], vec3(uv, float(map >> 8)), 0.0);
        }
    }
    return texel;
}

#ifndef COMPUTED  // a kernel has no differences between fragments
float sampled_level(uint map, uint arrays, vec2 uv) {
    float level = 0.0;
    for (uint i = 0u; i < ARRAYS; ++i) {
        if ((arrays >> i & 1u) != 0u && i == (map & 255u)) {
            level = textureQueryLod(texture_arrays[i], uv).x;
        }
    }
    return level;
}
#endif
#endif
