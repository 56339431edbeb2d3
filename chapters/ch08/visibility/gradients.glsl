// Textures by number, with given gradients: in a pass over all pixels the neighbour of a fragment may lie on another
// triangle, so the differences between fragments, by which a sampler chooses its level, say nothing.

#ifdef BINDLESS
vec4 sample_between(uint map, uint arrays, vec2 uv, vec2 dx, vec2 dy) {
    return textureGrad(textures_2d[nonuniformEXT(map)], uv, dx, dy);
}
#else
vec4 sample_between(uint map, uint arrays, vec2 uv, vec2 dx, vec2 dy) {
    vec4 found = vec4(0.0);
    for (uint number = 0u; number < ARRAYS; ++number) {
        if (number == (map & 255u) && (arrays >> number & 1u) != 0u) {
            found = textureGrad(texture_arrays[number], vec3(uv, float(map >> 8)), dx, dy);
        }
    }
    return found;
}
#endif
