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

// A work group lists the pixels of its area that are to be lit, and then lights the list: rates differ from block to block,
// but each invocation has a pixel as long as there are some. Neighbours in the list are neighbours in the picture, since
// invocations that run together cost as much as the slowest. Otherwise the order does not matter.
const uint PLACE = 5u, LAST = (1u << PLACE) - 1u;  // bits of a coordinate within the area
shared uint listed[RATE_AREA * RATE_AREA];  // the origin of what is lit at once, then the code of its rate
shared uint count;

void main() {
    ivec2 size = imageSize(color_lit), corner = ivec2(gl_WorkGroupID.xy) * RATE_AREA, block = block_of(COARSE);
    ivec2 blocks = RATE_AREA / block;
    int first = int(gl_LocalInvocationIndex), step = int(gl_WorkGroupSize.x * gl_WorkGroupSize.y);
    if (first == 0) {
        count = 0u;
    }
    barrier();
    for (int i = first; i < blocks.x * blocks.y; i += step) {
        ivec2 at = ivec2(i % blocks.x, i / blocks.x) * block;
        uint code = texelFetch(rates, (corner + at) / RATE_TEXEL, 0).r;
        ivec2 lit = block / block_of(code);  // as many as are lit in the block
        if (all(lessThan(corner + at, size))) {
            uint place = atomicAdd(count, uint(lit.x * lit.y));
            for (int y = 0; y < lit.y; ++y) {
                for (int x = 0; x < lit.x; ++x) {
                    uvec2 origin = uvec2(at + ivec2(x, y));
                    listed[place++] = origin.x | origin.y << PLACE | code << (2u * PLACE);
                }
            }
        }
    }
    barrier();
    for (int i = first; i < int(count); i += step) {
        uint entry = listed[i], code = entry >> (2u * PLACE);
        ivec2 origin = corner + ivec2(entry & LAST, entry >> PLACE & LAST), end = min(origin + block_of(code), size);
        if (all(lessThan(origin, size))) {
            light_at(lit_pixel(origin, block_of(code), size), size);
        }
        for (int y = origin.y; y < end.y; ++y) {
            for (int x = origin.x; x < end.x; ++x) {
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
