// Study fullscreen-pass, vertices: corners of the picture, or beyond it, from the number of the vertex.

layout(location = 0) out vec2 out_uv;

void main() {
    // uv is (0, 0) at the top left of the picture and (1, 1) at the bottom right; what lies at 2 is outside.
#if QUAD
    // Six numbers, two triangles: u is 0 1 1 1 0 0, v is 0 0 1 1 1 0.
    out_uv = vec2((VERTEX_ID + 2) / 3 % 2, (VERTEX_ID + 1) / 3 % 2);
#else
    // Three numbers: (0, 0), (2, 0), (0, 2). The picture is the half of that square which the triangle has.
    out_uv = vec2((VERTEX_ID & 1) * 2, VERTEX_ID & 2);
#endif
    gl_Position = vec4(out_uv * 2.0 - 1.0, 0.0, 1.0);
}
