// Deferred lighting for one pixel of each block: lighting.frag's own text, as lighting.comp calls it, so both give the
// same bits. A fragment stands for a block of RATE. With RATE 0 it stands for itself.
//
// Which fragments are run is in the depth that they are tested against (rates/blocks.py). A test before the shader spends
// no invocation on the others; a discard would.

layout(early_fragment_tests) in;

#define COMPUTED
ivec2 lit_at = ivec2(0);  // the pixel that is lit
#define PIXEL lit_at
vec2 in_uv = vec2(0.0);
layout(location = 0) out vec4 out_color;

#include "shading/lighting.frag"
#undef main
#include "codes.glsl"

void main() {
    ivec2 size = ivec2(frame.size.xy), block = block_of(RATE);
    lit_at = lit_pixel(ivec2(gl_FragCoord.xy) * block, block, size);
    in_uv = (vec2(lit_at) + 0.5) / vec2(size);
    light();
}
