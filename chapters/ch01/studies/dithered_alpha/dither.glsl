// Study dithered-alpha: sixteen thresholds for the pixels of a 4 x 4 tile.

// Bayer's order (B. E. Bayer 1973): however many of the first steps are taken, they lie as far apart as they can. A column of
// this matrix is a column of pixels: GLSL writes columns first.
const mat4 ORDER = mat4(
     1.0,  9.0,  3.0, 11.0,
    13.0,  5.0, 15.0,  7.0,
     4.0, 12.0,  2.0, 10.0,
    16.0,  8.0, 14.0,  6.0
);

// `alpha` lowered by up to a half, by another part at each pixel of a tile.
float dithered_alpha(float alpha, ivec2 pixel) {
    return clamp(alpha - 0.5 / 17.0 * ORDER[pixel.x & 3][pixel.y & 3], 0.0, 1.0);
}

// Whether a pixel is drawn. A threshold of 0 means that the material has no alpha test: then all are.
bool survives(float alpha, float threshold, ivec2 pixel) {
    return threshold <= 0.0 || dithered_alpha(alpha, pixel) >= threshold;
}
