// Study blue-noise: for each texel and each way a number of the noise, two triangular ones, a sample, codes dithered by
// either, and the sums of these over frames. All of it but a root is exact: whole numbers, and parts of 2^-24.

#include "blue_noise.glsl"
#include "gradient_noise.glsl"
#include "light.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(BIND(0, 0, 0), std430) readonly buffer Tables_ { uint tables[]; };
layout(BIND(0, 1, 1), std430) writeonly buffer Images_ { float images[]; };

// Two numbers in [0, 1) of a texel in a frame.
vec2 numbers_of(uint way, uvec2 texel, uint frame) {
    if (way == 0u) {
        return vec2(pcg3d(uvec3(texel, frame)).xy >> 8) * (1.0 / 16777216.0);
    }
    uint word = tables[((way - 1u) * SIZE + texel.y) * SIZE + texel.x];
    return vec2(animated_rank(word & 0xffffu, frame), animated_rank(word >> 16, frame));
}

// The number at which a triangle from -1 to 1 has this share of its area on the left.
float remapped(float share) {
    float from_middle = 2.0 * share - 1.0;
    return sign(from_middle) * (1.0 - sqrt(1.0 - abs(from_middle)));
}

float code_of(float light, float noise) { return floor(light * float(asked.steps) + (noise + 0.5)); }

void main() {
    uvec2 texel = gl_GlobalInvocationID.xy;
    uint way = gl_GlobalInvocationID.z;
    float light = light_at(texel.x);
    vec3 sums = vec3(0.0);
    float found[IMAGES];
    for (uint k = 0u; k < asked.frames; ++k) {
        vec2 numbers = numbers_of(way, texel, asked.first + k);
        float total = triangular(numbers), one = remapped(numbers.x);
        vec3 now = vec3(numbers.x < light ? 1.0 : 0.0, code_of(light, total), code_of(light, one));
        sums += now;
        if (k == 0u) {
            found[0] = numbers.x;
            found[1] = total;
            found[2] = one;
            found[3] = now.x;
            found[5] = now.y;
            found[7] = now.z;
        }
    }
    found[4] = sums.x;
    found[6] = sums.y;
    found[8] = sums.z;
    for (uint i = 0u; i < IMAGES; ++i) {
        images[((way * IMAGES + i) * SIZE + texel.y) * SIZE + texel.x] = found[i];
    }
}
