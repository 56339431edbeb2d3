// Study tessellation: what its shaders read of a frame.

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    mat4 view_from_world;
    mat4 clip_from_view;
    vec4 eye;
    vec4 terrain;  // scale of the distances, height of the hills, level of all edges or 0
} frame;
