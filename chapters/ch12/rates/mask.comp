// The mask of shading rates: each texel has the finest rate that one of its pixels needs. A work group has a tile of whole
// texels, and an invocation for each block of the coarse rate.

layout(local_size_x = TILE / COARSE_SIDE, local_size_y = TILE / COARSE_SIDE) in;

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

const int TEXELS = TILE / RATE_TEXEL;  // along the tile
const bool ALONE = RATE_TEXEL == COARSE_SIDE;  // an invocation for each texel
shared uint fine[TEXELS * TEXELS];

void main() {
    ivec2 block = block_of(COARSE), size = ivec2(frame.size.xy), tile = ivec2(gl_WorkGroupID.xy) * TEXELS;
    ivec2 within = ivec2(gl_LocalInvocationID.xy) * block, first = tile * RATE_TEXEL + within;
    ivec2 texel = within / RATE_TEXEL, lit = lit_pixel(first, block, size);
    int place = texel.y * TEXELS + texel.x, number = int(gl_LocalInvocationIndex);
    if (!ALONE) {
        if (number < TEXELS * TEXELS) {
            fine[number] = 0u;
        }
        barrier();
    }
    bool needed = false;
    for (int i = 0; i < block.x * block.y; ++i) {
        ivec2 pixel = first + ivec2(i % block.x, i / block.x);
        needed = needed || all(lessThan(pixel, size)) && needs_all(tile + texel, pixel, lit);
    }
    if (ALONE) {
        imageStore(rates, tile + texel, uvec4(needed ? 0u : COARSE));
        return;
    }
    if (needed) {
        atomicOr(fine[place], 1u);
    }
    barrier();
    if (number < TEXELS * TEXELS) {
        ivec2 at = tile + ivec2(number % TEXELS, number / TEXELS);
        imageStore(rates, at, uvec4(fine[number] != 0u ? 0u : COARSE));
    }
}
