// One level of a mip chain from the level above: the exact box filter, for sizes that are not powers of two as well.
//
// A target texel covers a window of 2 source texels where the source is even, and of 2 + 1/n where it is odd (n texels
// in the target): three texels, the outer two in part (weights as in NVIDIA's "Non-power-of-two mipmapping", 2005).
// So the mean of every level equals the mean of level 0.
//
// LAYERED: the images are arrays, and each layer gets its own level.
// SRGB: colour is sRGB-coded, and averaged as light. A processor would take the powers for all images if it were asked
// here whether to: it computes both sides of a condition.

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 size;    // target width and height, source width and height
    uint highest;  // code of the target, 0 if it holds floats
};
PUSH(Push, push)

#ifdef LAYERED
layout(BIND(0, 0, 0)) uniform sampler2DArray source;
layout(BIND(0, 1, 0), FORMAT) uniform writeonly image2DArray target;
#define TEXEL(place) ivec3(place, gl_GlobalInvocationID.z)
#else
layout(BIND(0, 0, 0)) uniform sampler2D source;
layout(BIND(0, 1, 0), FORMAT) uniform writeonly image2D target;
#define TEXEL(place) ivec2(place)
#endif

#ifdef SRGB
#include "srgb.glsl"
#endif

// Weights of the source texels 2i, 2i+1, 2i+2 for target texel i along one axis.
vec3 window(uint i, uint target_size, uint source_size) {
    if (source_size == 1u) {
        return vec3(1.0, 0.0, 0.0);
    }
    if ((source_size & 1u) == 0u) {
        return vec3(0.5, 0.5, 0.0);
    }
    float n = float(target_size);
    return vec3(n - float(i), n, float(i) + 1.0) / (2.0 * n + 1.0);
}

void main() {
    uvec2 id = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(id, push.size.xy))) {
        return;
    }
    vec3 across = window(id.x, push.size.x, push.size.z);
    vec3 down = window(id.y, push.size.y, push.size.w);
    vec4 sum = vec4(0.0);
    for (int y = 0; y < 3; ++y) {
        for (int x = 0; x < 3; ++x) {
            float weight = across[x] * down[y];
            if (weight > 0.0) {
                vec4 texel = texelFetch(source, TEXEL(ivec2(id * 2u) + ivec2(x, y)), 0);
#ifdef SRGB
                texel.rgb = linear_from_srgb(texel.rgb);
#endif
                sum += weight * texel;
            }
        }
    }
#ifdef SRGB
    sum.rgb = srgb_from_linear(sum.rgb);
#endif
    if (push.highest != 0u) {
        // A store may take either of the two codes around a value; at a code there is nothing left to choose.
        float highest = float(push.highest);
        sum = roundEven(sum * highest) / highest;
    }
    imageStore(target, TEXEL(id), sum);
}
