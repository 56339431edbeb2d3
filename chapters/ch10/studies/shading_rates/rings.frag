// Study shading-rates: rings around the middle of the picture, in the colour of the rate; each invocation counts itself.

#extension GL_EXT_fragment_shading_rate : require

#include "cells.glsl"
#include "palette.glsl"

layout(BIND(0, 0, 0), std430) buffer Counts_ { uint counts[]; };

layout(location = 0) flat in uint in_cell;
layout(location = 0) out vec4 out_color;

void main() {
    atomicAdd(counts[in_cell], 1u);
    vec2 p = gl_FragCoord.xy / float(push.size.z) - 0.5 * vec2(COLUMNS, ROWS);
    float wave = abs(2.0 * fract(0.5 * dot(p, p)) - 1.0);
    out_color = vec4(id_color(uint(gl_ShadingRateEXT)) * (0.25 + 0.75 * wave), 1.0);
}
