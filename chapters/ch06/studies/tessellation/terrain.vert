// Study tessellation, vertices: six for each square of the terrain, the corners of two patches.

layout(location = 0) out vec3 out_position;

const ivec2 CORNERS[6] = ivec2[](ivec2(0, 0), ivec2(0, 1), ivec2(1, 1), ivec2(0, 0), ivec2(1, 1), ivec2(1, 0));

void main() {
    int square = VERTEX_ID / 6;
    // From whole numbers: patches that share a corner compute the same bits.
    ivec2 place = ivec2(square % CELLS, square / CELLS) + CORNERS[VERTEX_ID % 6];
    precise vec2 flat_place = (vec2(place) / float(CELLS) - 0.5) * SIDE;
    out_position = vec3(flat_place.x, 0.0, flat_place.y);
}
