// Study shading-rates: the cells of both draws, and the rate of each.

struct Push {
    uvec4 size;  // of the picture in pixels; the side of a cell
    uvec4 draw;  // the first cell, the code of the rate
};
PUSH(Push, push)

// A corner of a cell, numbered along rows. Corners lie between pixels.
vec4 corner_of(uint cell, uint corner) {
    uvec2 place = uvec2(cell % COLUMNS, cell / COLUMNS) + uvec2(corner & 1u, corner >> 1);
    return vec4(vec2(place * push.size.z) / vec2(push.size.xy) * 2.0 - 1.0, 0.0, 1.0);
}

// Every second cell has the rate, like the dark squares of a chessboard.
int rate_of(uint cell) { return ((cell % COLUMNS + cell / COLUMNS) & 1u) != 0u ? int(push.draw.y) : 0; }
