// Study wireframe, vertices: where a corner is, and which of its triangle's three it is.

#include "mesh.glsl"
#include "transform.glsl"

layout(location = 0) in vec3 in_position;

// Mixed without perspective: then it changes evenly over the picture, and distances in the picture are what we are after.
layout(location = 0) noperspective out vec3 out_weights;
invariant gl_Position;

void main() {
    gl_Position = matrix_times(frame.clip_from_view, matrix_times(frame.view_from_object, vec4(in_position, 1.0)));
    // No triangle shares corners with another, so every third vertex is a first corner.
    int corner = VERTEX_ID % 3;
    out_weights = vec3(corner == 0, corner == 1, corner == 2);
}
