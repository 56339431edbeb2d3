// What both stages of a user interface know of a draw.

struct DrawConstants {
    vec4 transform;  // scale and offset of positions
    uvec4 flags;     // x: show the texture's red as grey
};

PUSH(DrawConstants, constants)
