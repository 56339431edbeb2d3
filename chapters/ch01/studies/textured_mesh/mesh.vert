// Study textured-mesh, vertices: from buffers now, one entry of each stream per vertex.

#include "mesh.glsl"
#include "transform.glsl"

layout(location = 0) in vec3 in_position;
layout(location = 1) in vec2 in_uv;

layout(location = 0) out vec2 out_uv;
invariant gl_Position;

void main() {
    gl_Position = matrix_times(frame.clip_from_view, matrix_times(frame.view_from_object, vec4(in_position, 1.0)));
    out_uv = in_uv;
}
