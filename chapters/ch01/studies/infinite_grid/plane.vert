// Study infinite-grid, vertices: one triangle that covers the picture. The plane is found by the fragments.

void main() {
    gl_Position = vec4(vec2((VERTEX_ID << 1) & 2, VERTEX_ID & 2) * 2.0 - 1.0, 0.0, 1.0);
}
