// The mean of a level and all wider ones. The wider ones are a mean of LEVELS - LEVEL already: no sum of levels is
// stored, which could exceed what half precision holds.

#include "finite.glsl"
#include "hdr/bloom.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D level;
layout(BIND(0, 1, 1)) uniform sampler2D wider;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    const float share = 1.0 / float(LEVELS - LEVEL + 1);
    out_color = vec4(finite_color(mix(enlarged(wider, at), texelFetch(level, at, 0).rgb, share)), 1.0);
}
