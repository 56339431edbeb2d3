// The mask of shading rates: a work group for each texel, which has the finest rate that one of its pixels needs.

layout(local_size_x = RATE_TEXEL, local_size_y = RATE_TEXEL) in;

#include "scene/scene.glsl"
#include "rates/codes.glsl"
#ifdef RADIUS
layout(BIND(1, 0, 0), RATE_FORMAT) uniform writeonly uimage2D rates;
#include "rates/radial.glsl"
#else
#include "shading/color_code.glsl"
#include "shading/normal_code.glsl"
layout(BIND(1, 0, 3)) uniform sampler2D gbuffer_base_color;
layout(BIND(1, 1, 4)) uniform NORMAL_SAMPLER gbuffer_normal;
layout(BIND(1, 2, 5)) uniform sampler2D gbuffer_material;
layout(BIND(1, 3, 6)) uniform sampler2D depth;
layout(BIND(1, 4, 7)) uniform usampler2D rates_before;
layout(BIND(1, 5, 0), RATE_FORMAT) uniform writeonly uimage2D rates;
#include "rates/sobel.glsl"
#endif

shared uint fine;

void main() {
    ivec2 texel = ivec2(gl_WorkGroupID.xy), pixel = ivec2(gl_GlobalInvocationID.xy), size = ivec2(frame.size.xy);
    if (gl_LocalInvocationIndex == 0u) {
        fine = 0u;
    }
    barrier();
    ivec2 block = block_of(COARSE);
    if (all(lessThan(pixel, size)) && needs_all(texel, pixel, lit_pixel(pixel / block * block, block, size))) {
        atomicOr(fine, 1u);
    }
    barrier();
    if (gl_LocalInvocationIndex == 0u) {
        imageStore(rates, texel, uvec4(fine != 0u ? 0u : COARSE));
    }
}
