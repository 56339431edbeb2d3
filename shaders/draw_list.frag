// The pixels of a user interface: display codes with straight alpha, which blending lays over the picture's.

#include "draw_list.glsl"

layout(location = 0) in vec2 uv;
layout(location = 1) in vec4 color;

layout(location = 0) out vec4 result;

layout(BIND(0, 0, 0)) uniform sampler2D image;

void main() {
    vec4 texel = texture(image, uv);
    if (constants.flags.x != 0u) texel = vec4(texel.rrr, 1.0);
    result = color * texel;
}
