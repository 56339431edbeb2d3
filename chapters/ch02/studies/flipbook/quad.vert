// Study flipbook, vertices: a square for each instance, and the number of its picture.

struct Shown {
    vec4 place;  // x, y, width, height, pixels
    uint frame;
    uint padding0, padding1, padding2;
};

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 picture;  // its size
} frame;

layout(BIND(0, 1, 1), std430) readonly buffer Shown_ {
    Shown shown[];
};

layout(location = 0) out vec2 out_uv;
layout(location = 1) flat out float out_layer;

const int CORNERS[6] = int[](0, 1, 2, 2, 1, 3);

void main() {
    Shown one = shown[INSTANCE_ID];
    int corner = CORNERS[VERTEX_ID];
    out_uv = vec2(corner & 1, corner >> 1);
    out_layer = float(one.frame);
    vec2 pixel = one.place.xy + out_uv * one.place.zw;
    gl_Position = vec4(pixel / frame.picture.xy * 2.0 - 1.0, 0.0, 1.0);
}
