// Study one-light, vertices: as in textured-mesh, and with them where the surface is and where it faces.

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
    // Light is computed in the object's space: any will do in which lengths and angles are right. The lamp is given there.
    out_position = in_position;
    out_normal = in_normal;
}
