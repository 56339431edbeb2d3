// Gives each pixel of a coarse texel the light of its block. The mask becomes a depth, so that the other pixels are lit
// next.

#include "codes.glsl"

layout(BIND(1, 0, 3)) uniform usampler2D rates;
layout(BIND(1, 1, 4)) uniform sampler2D color_blocks;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_color = vec4(0.0);
    gl_FragDepth = 0.0;
    if (texelFetch(rates, pixel / RATE_TEXEL, 0).r == COARSE) {  // the blocks of other texels hold nothing
        out_color = texelFetch(color_blocks, pixel / block_of(COARSE), 0);
        gl_FragDepth = 1.0;
    }
}
