// Study infinite-grid: which squares are drawn at a place, and how much ink is there.

const int LEVELS = 6;
const float POWERS[LEVELS] = float[](1.0, 10.0, 100.0, 1000.0, 10000.0, 100000.0);

const float THIN = 0.5;   // ink of the finest lines; 1 is black
const float THICK = 1.0;
const float HALF_WIDTH = 2.0;  // pixels from the middle of a line to where it ends

// How coarse to draw where a pixel is `footprint` metres long: at n the squares have a side of cell * 10^n, and from n to
// n + 1 the finest fade. `least` is how many pixels they must keep between them.
float grid_level(float footprint, float cell, float least) {
    // log2, since GLSL has no other; a footprint of nothing has no logarithm.
    float level = log2(max(footprint, 1e-30) * least / cell) * 0.30102999566398120 + 1.0;
    return clamp(level, 0.0, float(LEVELS) - 3.0);
}

// Ink of the lines of one size: full in their middle, none HALF_WIDTH pixels beside it. `place` is measured from a corner
// of a square, `footprint` is how far a pixel moves it along each axis.
float grid_lines(vec2 place, float side, vec2 footprint) {
    vec2 from_line = abs(mod(place + 0.5 * side, side) - 0.5 * side);
    vec2 ink = clamp(1.0 - from_line / (HALF_WIDTH * max(footprint, vec2(1e-30))), 0.0, 1.0);
    return max(ink.x, ink.y);
}
