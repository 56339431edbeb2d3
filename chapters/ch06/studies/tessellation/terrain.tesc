// Study tessellation, control: the levels of a patch. One invocation for each corner; each passes its corner on.

#include "terrain.glsl"

layout(vertices = 3) out;

layout(location = 0) in vec3 in_position[];
layout(location = 0) out vec3 out_position[];
layout(location = 1) patch out vec4 out_levels;

// The level of an edge, from its two vertices alone. A sum of two numbers is the same in either order.
float level(vec3 first, vec3 second) {
    if (frame.terrain.z > 0.0) {
        return frame.terrain.z;
    }
    precise float away = (distance(first, frame.eye.xyz) + distance(second, frame.eye.xyz)) * 0.5;
    return away <= 7.0 * frame.terrain.x ? 5.0 : away <= 10.0 * frame.terrain.x ? 3.0 : 1.0;
}

void main() {
    out_position[gl_InvocationID] = in_position[gl_InvocationID];
    if (gl_InvocationID == 0) {
        // Edge i is opposite to corner i.
        vec3 edges = vec3(level(in_position[1], in_position[2]), level(in_position[2], in_position[0]),
                          level(in_position[0], in_position[1]));
        float inside = max(max(edges.x, edges.y), edges.z);
        gl_TessLevelOuter[0] = edges.x;
        gl_TessLevelOuter[1] = edges.y;
        gl_TessLevelOuter[2] = edges.z;
        gl_TessLevelInner[0] = inside;
        out_levels = vec4(edges, inside);
    }
}
