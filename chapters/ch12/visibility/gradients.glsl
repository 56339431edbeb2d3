// Textures by number, with given gradients: a kernel has no differences between fragments, by which a sampler chooses its
// level. They would say nothing here: the neighbour of a pixel may lie on another triangle.
//
// SAMPLES_ALONG: software drivers share the footprint of an anisotropic filter between four invocations, which have
// triangles of their own. There the shader filters along the longer change by itself, with so many samples at most. The
// number is a constant of the dispatch: with one that is known, drivers unroll the loop, and compile for long.

#ifdef MIP_BIAS
const float FOOTPRINT = exp2(MIP_BIAS);
#else
const float FOOTPRINT = 1.0;
#endif

#ifndef SAMPLES_ALONG
#ifdef BINDLESS
vec4 sample_between(uint map, uint arrays, vec2 uv, vec2 dx, vec2 dy) {
    return textureGrad(textures_2d[nonuniformEXT(map)], uv, FOOTPRINT * dx, FOOTPRINT * dy);
}
#else
vec4 sample_between(uint map, uint arrays, vec2 uv, vec2 dx, vec2 dy) {
    vec4 found = vec4(0.0);
    for (uint number = 0u; number < ARRAYS; ++number) {
        if (number == (map & 255u) && (arrays >> number & 1u) != 0u) {
            found = textureGrad(texture_arrays[number], vec3(uv, float(map >> 8)), FOOTPRINT * dx, FOOTPRINT * dy);
        }
    }
    return found;
}
#endif
#else
#ifdef BINDLESS
vec2 texels_of(uint map, uint arrays) { return vec2(textureSize(textures_2d[nonuniformEXT(map)], 0)); }

vec4 sample_level(uint map, uint arrays, vec2 uv, float level) {
    return textureLod(textures_2d[nonuniformEXT(map)], uv, level);
}
#else
vec2 texels_of(uint map, uint arrays) {
    vec2 size = vec2(1.0);
    for (uint number = 0u; number < ARRAYS; ++number) {
        if (number == (map & 255u) && (arrays >> number & 1u) != 0u) {
            size = vec2(textureSize(texture_arrays[number], 0).xy);
        }
    }
    return size;
}

vec4 sample_level(uint map, uint arrays, vec2 uv, float level) {
    vec4 found = vec4(0.0);
    for (uint number = 0u; number < ARRAYS; ++number) {
        if (number == (map & 255u) && (arrays >> number & 1u) != 0u) {
            found = textureLod(texture_arrays[number], vec3(uv, float(map >> 8)), level);
        }
    }
    return found;
}
#endif

// The mean over the footprint of a pixel: samples side by side along its longer axis, each about as wide as the other.
vec4 sample_between(uint map, uint arrays, vec2 uv, vec2 dx, vec2 dy) {
    vec2 size = texels_of(map, arrays), x = dx * size, y = dy * size;
    float x2 = dot(x, x), y2 = dot(y, y), longer2 = max(max(x2, y2), 1e-30);
    float count = clamp(ceil(sqrt(longer2 / max(min(x2, y2), 1e-30))), 1.0, float(SAMPLES_ALONG));
    float level = 0.5 * log2(longer2) - log2(count) + log2(FOOTPRINT);
    vec2 along = x2 >= y2 ? dx : dy;
    vec4 sum = vec4(0.0);
    for (float i = 0.5; i < count; ++i) {
        sum += sample_level(map, arrays, uv + along * (i / count - 0.5), level);
    }
    return sum / count;
}
#endif
