// From linear, pre-exposed light to what a display shows: tone curve, then the sRGB code.

#include "tone.glsl"
#include "srgb.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D color_hdr;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    vec3 color = texelFetch(color_hdr, ivec2(gl_FragCoord.xy), 0).rgb;
#ifdef NEUTRAL
    color = tone_neutral(color);
#endif
    out_color = vec4(srgb_from_linear(clamp(color, 0.0, 1.0)), 1.0);
}
