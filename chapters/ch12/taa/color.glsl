// YCoCg (Malvar and Sullivan 2003): a luma and two differences of colours, orange against blue and green against purple.
// The box around a neighbourhood is tighter there, because neighbours differ mostly in brightness.
// All factors are powers of two, so that only sums are rounded.

vec3 ycocg_from_rgb(vec3 color) {
    float sides = 0.5 * (color.r + color.b);
    return vec3(0.5 * (color.g + sides), 0.5 * (color.r - color.b), 0.5 * (color.g - sides));
}

vec3 rgb_from_ycocg(vec3 color) {
    float sides = color.x - color.z;
    return vec3(sides + color.y, color.x + color.z, sides - color.y);
}
