// The histogram of log2 luminance. A bin holds the number of its pixels and the sum of their places inside of the bin in
// fixed point, so that an average over bins is not rounded to their width. All sums are integers: their order does not
// matter, and equal pictures give equal bits.

layout(local_size_x = 16, local_size_y = 16) in;

#include "scene/scene.glsl"
#include "luminance.glsl"
#include "hdr/bins.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D color_hdr;
#ifdef SKIP_EMPTY
layout(BIND(1, 1, 4)) uniform sampler2D depth;
layout(BIND(1, 2, 4), std430) buffer Histogram_ { uint bins[2 * BINS]; };
#else
layout(BIND(1, 1, 4), std430) buffer Histogram_ { uint bins[2 * BINS]; };
#endif
#include "hdr/measured.glsl"

shared uint counted[2 * BINS];

void main() {
    uint i = gl_LocalInvocationIndex;
    counted[i] = 0u;
    counted[i + BINS] = 0u;
    barrier();

    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(color_hdr, 0);
    vec3 light;
    if (all(lessThan(pixel, size)) && measured_light(pixel, light)) {
        float nits = luminance(light) / exposure();
        float place = 0.0;  // black, and what is not a number, is in the first bin
        if (nits > 0.0) {
            place = clamp((log2(nits) - LOG2_LOWEST) / BIN_WIDTH, 0.0, float(BINS) - 1e-3);
        }
        uint bin = uint(place);
        atomicAdd(counted[bin], 1u);
        atomicAdd(counted[bin + BINS], uint((place - float(bin)) * float(place_steps()) + 0.5));
    }
    barrier();

    if (counted[i] != 0u) {
        atomicAdd(bins[i], counted[i]);
        atomicAdd(bins[i + BINS], counted[i + BINS]);
    }
}
