// Study linear-depth: stored depth, distance, and the error of the distance; standard Z above, reversed Z below.

#include "depth.glsl"
#include "palette.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D reversed_depth;
layout(BIND(0, 1, 1)) uniform sampler2D standard_depth;
layout(BIND(0, 2, 2)) uniform sampler2D distances;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    ivec2 size = textureSize(distances, 0), panels = ivec2(3, 2);
    // With two rows of panels, a pixel's middle is on the border of two texels. A quarter of a texel keeps rounding from
    // choosing one.
    ivec2 at = ivec2(in_uv * vec2(panels * size) + 0.25);
    ivec2 panel = at / size, texel = at % size;
    bool standard = panel.y == 0;
    float depth = standard ? texelFetch(standard_depth, texel, 0).r : texelFetch(reversed_depth, texel, 0).r;
    float metres = texelFetch(distances, texel, 0).r;
    if (metres == 0.0) {  // nothing was drawn here
        out_color = vec4(0.05, 0.05, 0.06, 1.0);
        return;
    }
    float found = distance_of(depth, standard);
    vec3 color = vec3(depth);
    if (panel.x == 2) {
        color = heat((log2(max(abs(found - metres), 1e-9)) / log2(10.0) + 7.0) / 7.0);
    } else if (panel.x == 1) {
        color = vec3(found / push.lamp.w);
    }
    out_color = vec4(color, 1.0);
}
