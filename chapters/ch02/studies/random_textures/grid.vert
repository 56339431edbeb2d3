// Study random-textures, vertices: a grid of cells, two triangles each, with a number for every triangle.

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 picture;  // width, height, cells across
} frame;

layout(location = 0) flat out uint out_triangle;

const ivec2 CORNERS[6] = ivec2[](ivec2(0, 0), ivec2(0, 1), ivec2(1, 1), ivec2(0, 0), ivec2(1, 1), ivec2(1, 0));

void main() {
    int cell = VERTEX_ID / 6, across = int(frame.picture.z);
    ivec2 corner = ivec2(cell % across, cell / across) + CORNERS[VERTEX_ID % 6];
    out_triangle = uint(VERTEX_ID / 3);
    // Rasterisers round to at most 1/256 of a pixel, and no edge comes closer than 1/8 to a pixel's centre.
    vec2 pixel = vec2((corner - 1) * CELL) + vec2(0.25, 0.125);
    gl_Position = vec4(pixel / frame.picture.xy * 2.0 - 1.0, 0.0, 1.0);
}
