// Deferred lighting as compute: the fragment shader's own text, called for one pixel by each invocation.
//
// Nothing is drawn, so there is no triangle, no interpolation and no attachment: the pixel is the invocation's number, and
// its colour is stored where it belongs. Groups of 8x8 stand over the edge of a picture that is no multiple of 8.

layout(local_size_x = 8, local_size_y = 8) in;

#define COMPUTED
ivec2 lit_at = ivec2(0);  // the pixel that is lit
#define PIXEL lit_at
vec2 in_uv = vec2(0.0);  // what a fragment shader gets and gives
vec4 out_color = vec4(0.0);

#include "lighting.frag"
#undef main

layout(BIND(1, LIT_BINDING, 0), FORMAT) uniform writeonly image2D color_lit;

void light_at(ivec2 pixel, ivec2 size) {
    lit_at = pixel;
    in_uv = (vec2(pixel) + 0.5) / vec2(size);
    light();
}

#ifdef RATE_BINDING
#include "rates/codes.glsl"
layout(BIND(1, RATE_BINDING, RATE_BINDING + 3)) uniform usampler2D rates;

// A work group for each texel of the mask. Its invocations share the blocks of the texel, however many there are.
void main() {
    ivec2 size = imageSize(color_lit), texel = ivec2(gl_WorkGroupID.xy);
    ivec2 block = block_of(texelFetch(rates, texel, 0).r), blocks = RATE_TEXEL / block;
    int step = int(gl_WorkGroupSize.x * gl_WorkGroupSize.y);
    for (int i = int(gl_LocalInvocationIndex); i < blocks.x * blocks.y; i += step) {
        ivec2 first = texel * RATE_TEXEL + ivec2(i % blocks.x, i / blocks.x) * block, end = min(first + block, size);
        if (all(lessThan(first, size))) {
            light_at(lit_pixel(first, block, size), size);
        }
        for (int y = first.y; y < end.y; ++y) {
            for (int x = first.x; x < end.x; ++x) {
                imageStore(color_lit, ivec2(x, y), out_color);
            }
        }
    }
}
#else
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(color_lit);
    if (all(lessThan(pixel, size))) {
        light_at(pixel, size);
        imageStore(color_lit, pixel, out_color);
    }
}
#endif
