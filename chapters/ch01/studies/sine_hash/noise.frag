// Study sine-hash, fragments: cells of noise, by the sine on the left, by whole numbers on the right.

#include "noise.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 cells;
} frame;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    vec2 cell = floor(in_uv * frame.cells.xy);
    float value = in_uv.x < 0.5 ? sine_hash(cell) : integer_hash(uvec2(cell));
    // Codes, not light: what is evenly spread is the number that the eye is shown.
    out_color = vec4(vec3(value), 1.0);
}
