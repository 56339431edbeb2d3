// Study texture-handles, vertices: a rectangle of the grid for each draw, and the handle of its texture.

#if HANDLES
layout(BIND(0, 0, 0), std430) readonly buffer Handles_ {
    uvec2 handles[];  // 64 bits each, the low ones first
};

layout(location = 1) flat out uvec2 out_handle;
#endif

layout(location = 0) out vec2 out_uv;

void main() {
    // Each draw has one instance, whose number is that of the draw: `baseInstance` of its command.
    int number = INSTANCE_ID;
    out_uv = vec2(VERTEX_ID & 1, VERTEX_ID >> 1);
    vec2 cell = vec2(number % ACROSS, number / ACROSS) + 0.5 + 0.9 * (out_uv - 0.5);
    gl_Position = vec4(cell / vec2(ACROSS, DOWN) * 2.0 - 1.0, 0.0, 1.0);
#if HANDLES
    out_handle = handles[number];
#endif
}
