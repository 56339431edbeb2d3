// Casters, vertices: what the forward pass does with them, seen from a light.

#define main project
#include "shading/forward.vert"
#undef main

struct Draw {
    uvec4 number;  // x: which of the faces that the frame draws
};
PUSH(Draw, pushed)

void main() {
    project();
    gl_Position = face_clip(shadow_faces[drawn_face(pushed.number.x)], out_position);
}
