// Study vertex-pulling, vertices: fetched by the GPU ahead of this shader, or by the shader itself.

#include "transform.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    mat4 view_from_object;
    mat4 clip_from_view;
} frame;

#if PULLED
// Five floats, 20 bytes. With vec3 and vec2 the compiler would pad this to 24, and read the wrong numbers.
struct Vertex {
    float x, y, z, u, v;
};

layout(BIND(0, 1, 1), std430) readonly buffer Vertices_ {
    Vertex vertices[];
};
#else
layout(location = 0) in vec3 in_position;
layout(location = 1) in vec2 in_uv;
#endif

layout(location = 0) out vec2 out_uv;
invariant gl_Position;

void main() {
#if PULLED
    // The draw is an indexed one: this number is what the index buffer says, and a vertex that triangles share is still
    // shaded once.
    Vertex vertex = vertices[VERTEX_ID];
    vec3 position = vec3(vertex.x, vertex.y, vertex.z);
    vec2 uv = vec2(vertex.u, vertex.v);
#else
    vec3 position = in_position;
    vec2 uv = in_uv;
#endif
    gl_Position = matrix_times(frame.clip_from_view, matrix_times(frame.view_from_object, vec4(position, 1.0)));
    out_uv = uv;
}
