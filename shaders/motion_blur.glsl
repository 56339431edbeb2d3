// Motion blur: the way of a pixel over the picture while the shutter is open.

// The way in pixels: `motion` is that of a frame in uv units, the shutter is open for `shutter` frames, and the moment of
// the frame is its middle. A way is `longest` at most.
vec2 smear_of(vec2 motion, vec2 size, float shutter, float longest) {
    vec2 way = motion * size * shutter;
    float length_px = length(way);
    return length_px > longest ? way * (longest / length_px) : way;
}

// The part of a pixel's light that reaches a place so many pixels away, by the length of its way: what a box of that length
// around it covers of the pixel there.
float smear_reaches(float length_px, float distance) {
    return clamp(0.5 * length_px + 0.5 - distance, 0.0, 1.0);
}
