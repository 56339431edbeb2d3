// Study dithered-alpha, fragments: a sheet whose alpha grows from left to right, over a background.

#include "dither.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 knobs;  // threshold, alpha, dither
} frame;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    float threshold = frame.knobs.x;
    float alpha = frame.knobs.y < 0.0 ? in_uv.x : frame.knobs.y;
    bool drawn = frame.knobs.z > 0.5 ? survives(alpha, threshold, ivec2(gl_FragCoord.xy)) : alpha >= threshold;
    // No blending, and so no order: whatever is behind can be drawn before or after. But the GPU can no longer know depth
    // before the shader has run. A material without an alpha test gets a shader without this line.
    if (!drawn) discard;
    out_color = vec4(0.95, 0.75, 0.35, 1.0);
}
