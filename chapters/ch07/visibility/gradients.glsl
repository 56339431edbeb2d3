// Textures by number, with given gradients: a kernel has no differences between fragments, by which a sampler chooses its
// level. They would say nothing here: the neighbour of a pixel may lie on another triangle.

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
