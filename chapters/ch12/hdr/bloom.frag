// The picture with a part of its bright light replaced by the same light spread. What a pixel gives away its neighbours
// get: the sum over the picture stays, and a constant picture stays as it is.

#include "finite.glsl"
#include "bright.glsl"
#include "hdr/bloom.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D color_hdr;
layout(BIND(0, 1, 1)) uniform sampler2D spread;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 sharp = texelFetch(color_hdr, at, 0);
    vec3 color = finite_color(sharp.rgb);
    vec3 change = enlarged(spread, at) - bright_part(color, THRESHOLD);
    out_color = vec4(finite_color(color + STRENGTH * change), sharp.a);
}
