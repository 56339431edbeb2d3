// The mask as a depth for the fragments of blocks: 0, where the test lets them pass, for texels of coarse rate, else 1.

#include "codes.glsl"

layout(BIND(1, 0, 3)) uniform usampler2D rates;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy) * block_of(COARSE);
    gl_FragDepth = texelFetch(rates, pixel / RATE_TEXEL, 0).r == COARSE ? 0.0 : 1.0;
}
