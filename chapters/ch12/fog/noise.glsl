// The noise of the medium: a volume of NOISE_SIZE^3 halves, made once, behind the ranks of blue noise in the tables. It
// repeats in all axes, and wind shifts it. Its mean is one half, so that the factor of the medium has the mean 1.

const uint NOISE_PLACE = 128u * 128u;

uint noise_index(ivec3 texel) {
    uvec3 wrapped = uvec3(texel) & uint(NOISE_SIZE - 1);
    return (wrapped.z * uint(NOISE_SIZE) + wrapped.y) * uint(NOISE_SIZE) + wrapped.x;
}

float noise_texel(ivec3 texel) {
    uint index = noise_index(texel);
    vec2 pair = unpackHalf2x16(fog_tables[NOISE_PLACE + (index >> 1)]);
    return (index & 1u) == 0u ? pair.x : pair.y;
}

float noise_at(vec3 periods) {
    vec3 place = periods * float(NOISE_SIZE) - 0.5, first = floor(place), part = place - first;
    float sum = 0.0;
    for (int i = 0; i < 8; ++i) {
        ivec3 corner = ivec3(i & 1, i >> 1 & 1, i >> 2);
        vec3 weights = mix(1.0 - part, part, vec3(corner));
        sum += weights.x * weights.y * weights.z * noise_texel(ivec3(first) + corner);
    }
    return sum;
}

#ifdef FROXELS  // of a frame
// What is at a point was upwind before.
float noise_factor(vec3 position) {
    float noise = noise_at(position * fog.shape.w - fog.wind.xyz);
    return max(1.0 + fog.shape.z * (2.0 * noise - 1.0), 0.0);
}
#endif
