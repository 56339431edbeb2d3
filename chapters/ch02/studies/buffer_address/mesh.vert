// Study buffer-address, vertices: read where an address leads, or through a descriptor.

#if BY_ADDRESS
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#endif

#include "transform.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    mat4 view_from_object;
    mat4 clip_from_view;
    uvec2 address;  // 64 bits, the low ones first
} frame;

struct Vertex {
    float x, y, z, u, v;
};

#if BY_ADDRESS
// A type for what lies at an address; no variable, no set, no binding. The compiler may assume that every address of it
// is a multiple of the alignment: 16 unless it is told otherwise.
layout(buffer_reference, buffer_reference_align = 4, std430) readonly buffer Vertices {
    Vertex vertices[];
};
#else
layout(BIND(0, 1, 1), std430) readonly buffer Vertices_ {
    Vertex vertices[];
};
#endif

layout(location = 0) out vec2 out_uv;
invariant gl_Position;

void main() {
#if BY_ADDRESS
    // A pointer, made from a number. `robustBufferAccess` bounds what descriptors reach, and nothing bounds this.
    Vertices mesh = Vertices(frame.address);
    Vertex vertex = mesh.vertices[VERTEX_ID];
#else
    Vertex vertex = vertices[VERTEX_ID];
#endif
    vec4 position = vec4(vertex.x, vertex.y, vertex.z, 1.0);
    gl_Position = matrix_times(frame.clip_from_view, matrix_times(frame.view_from_object, position));
    out_uv = vec2(vertex.u, vertex.v);
}
