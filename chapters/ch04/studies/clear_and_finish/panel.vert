// Study clear-and-finish, vertices: two panels that cross, one nearer on the left, the other on the right.

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 place;  // x: to the side
} frame;

layout(location = 0) out vec3 out_color;

void main() {
    vec2 corner = vec2((VERTEX_ID + 2) / 3 % 2, (VERTEX_ID + 1) / 3 % 2) * 2.0 - 1.0;
    float turned = INSTANCE_ID == 0 ? 1.0 : -1.0;
    vec2 center = vec2(frame.place.x, turned * 0.15);
    // Depth from 0.2 to 0.6, and not divided by anything: there is no perspective here.
    gl_Position = vec4(center + corner * vec2(0.6, 0.5), 0.4 + 0.2 * turned * corner.x, 1.0);
    out_color = INSTANCE_ID == 0 ? vec3(0.1, 0.35, 0.5) : vec3(0.75, 0.25, 0.15);
}
