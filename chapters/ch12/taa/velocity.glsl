// Which motion vector a pixel follows. At a silhouette the pixels outside must follow the edge, too, because it is smoothed
// into them (Karis 2014, "High quality temporal supersampling"). Both choices begin with the pixel itself, and only what is
// closer, or longer, takes its place: sky alone keeps its own vector. Pixels beyond the border are those of the border.

// The pixel of the 3x3 with the closest depth. Depth is reversed: a larger value is closer, and sky has 0.
ivec2 closest(sampler2D depth, ivec2 pixel) {
    ivec2 last = textureSize(depth, 0) - 1, found = clamp(pixel, ivec2(0), last);
    float nearest = texelFetch(depth, found, 0).r;
    for (int i = 0; i < 9; ++i) {
        ivec2 at = clamp(pixel + ivec2(i % 3 - 1, i / 3 - 1), ivec2(0), last);
        float value = texelFetch(depth, at, 0).r;
        if (value > nearest) {
            nearest = value;
            found = at;
        }
    }
    return found;
}

// The longest vector of the 3x3, in the picture's own measure: `motion` is in uv units, whose axes differ in pixels.
vec2 longest(sampler2D motion, ivec2 pixel) {
    ivec2 size = textureSize(motion, 0), last = size - 1;
    vec2 found = texelFetch(motion, clamp(pixel, ivec2(0), last), 0).xy, pixels = found * vec2(size);
    float most = dot(pixels, pixels);
    for (int i = 0; i < 9; ++i) {
        ivec2 at = clamp(pixel + ivec2(i % 3 - 1, i / 3 - 1), ivec2(0), last);
        vec2 value = texelFetch(motion, at, 0).xy;
        pixels = value * vec2(size);
        float squared = dot(pixels, pixels);
        if (squared > most) {
            most = squared;
            found = value;
        }
    }
    return found;
}
