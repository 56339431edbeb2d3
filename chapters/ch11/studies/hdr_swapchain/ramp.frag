// Study hdr-swapchain, the scene: strips of scene light that doubles at equal steps from left to right; 1.0 is paper white.

#include "strips.glsl"

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    int strip = min(int(in_uv.y * float(STRIPS)), STRIPS - 1);
    out_color = vec4(STRIP_COLORS[strip] * exp2(stops_at(in_uv.x)), 1.0);
}
