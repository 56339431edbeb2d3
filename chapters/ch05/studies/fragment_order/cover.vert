// Study fragment-order, vertices of the first draw: one triangle larger than the picture, or two that share a diagonal.

void main() {
#if QUAD
    vec2 place = vec2((VERTEX_ID + 2) / 3 % 2, (VERTEX_ID + 1) / 3 % 2);
#else
    vec2 place = vec2((VERTEX_ID & 1) * 2, VERTEX_ID & 2);
#endif
    gl_Position = vec4(place * 2.0 - 1.0, 0.0, 1.0);
}
