// Deferred lighting as compute: the fragment shader's own text, called for one pixel by each invocation.
//
// Nothing is drawn, so there is no triangle, no interpolation and no attachment: the pixel is the invocation's number, and
// its colour is stored where it belongs. Groups of 8x8 stand over the edge of a picture that is no multiple of 8.

layout(local_size_x = 8, local_size_y = 8) in;

#define COMPUTED
#define PIXEL gl_GlobalInvocationID
vec2 in_uv = vec2(0.0);  // what a fragment shader gets and gives
vec4 out_color = vec4(0.0);

#include "lighting.frag"
#undef main

layout(BIND(1, LIT_BINDING, 0), FORMAT) uniform writeonly image2D color_lit;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(color_lit);
    if (any(greaterThanEqual(pixel, size))) {
        return;
    }
    in_uv = (vec2(pixel) + 0.5) / vec2(size);
    light();
    imageStore(color_lit, pixel, out_color);
}
