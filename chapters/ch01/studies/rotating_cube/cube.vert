// Study rotating-cube, vertices: from the cube's own space to the camera's, and from there into the picture.

#include "transform.glsl"

// The same for all vertices of a frame, and so "uniform"; another one for each frame.
layout(BIND(0, 0, 0), std140) uniform Frame_ {
    mat4 view_from_object;
    mat4 clip_from_view;
} frame;

// Eight corners, numbered by the bits zyx, and six faces of two triangles each.
const int CORNERS[36] = int[](
    0, 2, 3, 0, 3, 1,  // z = 0
    4, 5, 7, 4, 7, 6,  // z = 1
    0, 4, 6, 0, 6, 2,  // x = 0
    1, 3, 7, 1, 7, 5,  // x = 1
    0, 1, 5, 0, 5, 4,  // y = 0
    2, 6, 7, 2, 7, 3   // y = 1
);

layout(location = 0) out vec3 out_color;
invariant gl_Position;

void main() {
    int corner = CORNERS[VERTEX_ID];
    vec3 place = vec3(corner & 1, (corner >> 1) & 1, (corner >> 2) & 1);
    // One metre wide, around the origin. Place and colour are the same three numbers.
    gl_Position = matrix_times(frame.clip_from_view, matrix_times(frame.view_from_object, vec4(place - 0.5, 1.0)));
    out_color = place;
}
