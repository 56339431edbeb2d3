// Study textured-quads, vertices: six for each quad, from its rectangle of pixels.

struct Quad {
    vec4 place;  // x, y, width, height, pixels
    uint shows;
    uint padding0, padding1, padding2;
};

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 picture;  // its size, near, far
} frame;

layout(BIND(0, 1, 1), std430) readonly buffer Quads_ {
    Quad quads[];
};

layout(location = 0) out vec2 out_uv;
layout(location = 1) flat out uint out_shows;

const int CORNERS[6] = int[](0, 1, 2, 2, 1, 3);

void main() {
    Quad quad = quads[VERTEX_ID / 6];
    int corner = CORNERS[VERTEX_ID % 6];
    out_uv = vec2(corner & 1, corner >> 1);
    out_shows = quad.shows;
    // Corners lie between pixels, at whole numbers; centres lie at halves. So uv at the centre of the i-th of n pixels is
    // (i + 0.5) / n: the centre of the i-th of n texels. Nothing has to be moved by half of anything.
    vec2 pixel = quad.place.xy + out_uv * quad.place.zw;
    gl_Position = vec4(pixel / frame.picture.xy * 2.0 - 1.0, 0.0, 1.0);
}
