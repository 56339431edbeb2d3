// Study wireframe: what both of its shaders read of a frame.

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    mat4 view_from_object;
    mat4 clip_from_view;
    vec4 face;
    vec4 edge;  // w: thickness, pixels
} frame;
