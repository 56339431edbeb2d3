// One triangle that covers the whole picture; its uv runs from 0 to 1 with row 0 on top.

layout(location = 0) out vec2 out_uv;

void main() {
    out_uv = vec2((VERTEX_ID << 1) & 2, VERTEX_ID & 2);
    gl_Position = vec4(out_uv * 2.0 - 1.0, 0.0, 1.0);
}
