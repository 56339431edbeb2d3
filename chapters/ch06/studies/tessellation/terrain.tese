// Study tessellation, evaluation: a vertex of the surface from its barycentric coordinates in the patch.

#include "terrain.glsl"
#include "transform.glsl"

layout(triangles, equal_spacing, ccw) in;

layout(location = 0) in vec3 in_position[];
layout(location = 1) patch in vec4 in_levels;

layout(location = 0) out vec3 out_position;
layout(location = 1) out vec3 out_normal;
layout(location = 2) out float out_level;
invariant gl_Position;

const vec4 WAVES[3] = vec4[](vec4(1.7, 2.6, 0.4, 0.6), vec4(-4.3, 2.2, 1.9, 0.4), vec4(6.1, 5.3, 2.2, 0.2));

void main() {
    // The tessellator gives x and 1 - x on the two sides of an edge, and 0 for the corner that is not on it. A sum of
    // two products and a zero has the same bits in any order, unless it is a fused multiply-add: hence `precise`.
    precise vec3 position = gl_TessCoord.x * in_position[0] + gl_TessCoord.y * in_position[1];
    position += gl_TessCoord.z * in_position[2];
    precise float height = 0.0;
    vec2 slope = vec2(0.0);
    for (int i = 0; i < 3; ++i) {
        precise float phase = WAVES[i].x * position.x + WAVES[i].y * position.z + WAVES[i].z;
        height += WAVES[i].w * sin(phase);
        slope += WAVES[i].w * cos(phase) * WAVES[i].xy;
    }
    position.y = frame.terrain.y * height;
    gl_Position = clip_position(frame.clip_from_view, frame.view_from_world, position);
    out_position = position;
    out_normal = vec3(-frame.terrain.y * slope.x, 1.0, -frame.terrain.y * slope.y);
    out_level = in_levels.w;
}
