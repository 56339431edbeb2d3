// Where the pixels of the picture lie among those that are drawn at a scale.
//
// A jitter moves the drawn picture right and down, so what the steady picture has at a place is drawn at place + jitter.
// Both have the same borders: the ratio of their sizes is exact along each axis, whatever the scale was rounded to.

// The centre of a pixel of a picture of `size` pixels, in drawn pixels.
vec2 drawn_place(ivec2 pixel, ivec2 size) {
    return (vec2(pixel) + 0.5) * (frame.size.xy / vec2(size)) + 0.5 * frame.jitter * frame.size.xy;
}

// The drawn pixel whose centre is nearest.
ivec2 drawn_pixel(vec2 place) {
    return clamp(ivec2(floor(place)), ivec2(0), ivec2(frame.size.xy) - 1);
}
