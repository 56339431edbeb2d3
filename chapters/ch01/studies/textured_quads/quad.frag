// Study textured-quads, fragments: a texel as it is, or depth as a distance.

#include "linear.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 picture;  // its size, near, far
} frame;

layout(BIND(0, 2, 0)) uniform sampler2D shown_picture;
layout(BIND(0, 3, 1)) uniform sampler2D shown_distance;

layout(location = 0) in vec2 in_uv;
layout(location = 1) flat in uint in_shows;
layout(location = 0) out vec4 out_color;

void main() {
    if (in_shows == 0u) {
        out_color = vec4(textureLod(shown_picture, in_uv, 0.0).rgb, 1.0);
        return;
    }
    float depth = textureLod(shown_distance, in_uv, 0.0).r;
    out_color = vec4(vec3(shown_depth(depth, frame.picture.z, frame.picture.w)), 1.0);
}
