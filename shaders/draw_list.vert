// The vertices of a user interface: from its own units to clip coordinates. y points down in both.

#include "draw_list.glsl"

layout(location = 0) in vec2 in_position;
layout(location = 1) in vec2 in_uv;
layout(location = 2) in vec4 in_color;

layout(location = 0) out vec2 uv;
layout(location = 1) out vec4 color;

void main() {
    uv = in_uv;
    color = in_color;
    precise vec2 place = in_position * constants.transform.xy + constants.transform.zw;
    gl_Position = vec4(place, 0.0, 1.0);
}
