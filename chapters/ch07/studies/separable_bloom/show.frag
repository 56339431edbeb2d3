// Study separable-bloom: to the left the picture, to the right the picture with its bloom, by the same tone curve.

#define ACCESS readonly
#include "texels.glsl"
#include "tone_curves.glsl"
#include "srgb.glsl"

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    ivec2 texel = min(ivec2(in_uv * float(SIDE)), SIDE - 1);
    int at = texel.y * SIDE + texel.x;
    vec3 color = from[at].rgb;
    if (in_uv.x > 0.5) {
        color += STRENGTH * to[at].rgb;
    }
    out_color = vec4(srgb_from_linear(tone_reinhard(color, WHITE)), 1.0);
}
