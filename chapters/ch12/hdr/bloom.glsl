// Filters between levels of the bloom pyramid. Both have weights that sum up to 1 at each texel that is written, so
// constants are preserved. Away from borders they also give each texel that is read the same weight in total, so the sum
// of all light is preserved. Texels are fetched and weighted here, since the weights of a sampler have 8 bits.

vec4 texel_at(sampler2D image, ivec2 at) {
    return texelFetch(image, clamp(at, ivec2(0), textureSize(image, 0) - 1), 0);
}

// A picture twice as large at the four texels around `at`, bilinearly: weights 3/4 and 1/4 along each axis.
vec3 enlarged(sampler2D image, ivec2 at) {
    ivec2 near = at >> 1;
    ivec2 far = near + ((at & 1) * 2 - 1);
    vec3 sum = 9.0 * texel_at(image, near).rgb + 3.0 * texel_at(image, ivec2(far.x, near.y)).rgb;
    return (sum + 3.0 * texel_at(image, ivec2(near.x, far.y)).rgb + texel_at(image, far).rgb) / 16.0;
}
