// Study torus-knot, vertices: the kernel's vertex at the number of the index.

#include "transform.glsl"
#include "vertex.glsl"

layout(BIND(0, 0, 0), std430) readonly buffer Vertices_ {
    Vertex vertices[];
};
layout(BIND(0, 1, 0), std140) uniform Frame_ {
    mat4 view_from_object;
    mat4 clip_from_view;
} frame;

layout(location = 0) out vec3 out_position;
layout(location = 1) out vec3 out_normal;
layout(location = 2) out vec2 out_place;
invariant gl_Position;

void main() {
    Vertex vertex = vertices[VERTEX_ID];
    vec4 position = matrix_times(frame.view_from_object, vec4(vertex.position.xyz, 1.0));
    gl_Position = matrix_times(frame.clip_from_view, position);
    out_position = position.xyz;
    out_normal = mat3(frame.view_from_object) * vertex.normal.xyz;  // a rotation and a uniform scale: it stays perpendicular
    out_place = vec2(vertex.position.w, vertex.normal.w);
}
