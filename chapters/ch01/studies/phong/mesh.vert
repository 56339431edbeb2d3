// Study phong, vertices: as in one-light.

#include "mesh.glsl"
#include "transform.glsl"

layout(location = 0) in vec3 in_position;
layout(location = 1) in vec2 in_uv;
layout(location = 2) in vec3 in_normal;

layout(location = 0) out vec2 out_uv;
layout(location = 1) out vec3 out_position;
layout(location = 2) out vec3 out_normal;
invariant gl_Position;

void main() {
    gl_Position = matrix_times(frame.clip_from_view, matrix_times(frame.view_from_object, vec4(in_position, 1.0)));
    out_uv = in_uv;
    out_position = in_position;
    out_normal = in_normal;
}
