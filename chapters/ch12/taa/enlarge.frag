// Nearest pixels at the size of the picture. IMAGE: 0 depth, 1 motion vectors.

#include "scene/scene.glsl"
#include "taa/drawn.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D drawn;
#if IMAGE == 1
layout(location = 0) out vec2 out_motion;
#endif

layout(location = 0) in vec2 in_uv;

void main() {
    // The size of the picture is not known here, but the triangle's uv is the pixel's place in it.
    ivec2 pixel = drawn_pixel(in_uv * frame.size.xy + 0.5 * frame.jitter * frame.size.xy);
#if IMAGE == 0
    gl_FragDepth = texelFetch(drawn, pixel, 0).r;
#else
    out_motion = texelFetch(drawn, pixel, 0).rg;
#endif
}
