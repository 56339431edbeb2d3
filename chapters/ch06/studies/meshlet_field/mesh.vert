// Studies of meshlets, vertices: found by their number, and transformed by the instance that the command names.

#define CULLING 0
#include "studies/meshlet_field/field.glsl"
#include "studies/meshlet_field/vertex.glsl"

layout(location = 0) out vec3 out_normal;
layout(location = 1) flat out uint out_instance;
invariant gl_Position;

void main() {
    uint number = uint(INSTANCE_ID);
    Vertex vertex = vertex_of(instances[number], uint(VERTEX_ID));
    gl_Position = vertex.clip;
    out_normal = vertex.normal;
    out_instance = number;
}
