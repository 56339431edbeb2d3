// What may be written to a colour target: nothing that is not a number, nothing above what half precision holds.

const float LARGEST_COLOR = 65504.0;

// NaN becomes 0 and infinity the largest colour: one bad texel must not spread through filters and histories.
vec3 finite_color(vec3 color) {
    color = mix(color, vec3(0.0), isnan(color));
    return clamp(color, 0.0, LARGEST_COLOR);
}
