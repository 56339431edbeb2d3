// Motion blur: the way of a pixel over the picture while the shutter is open.

// The way in pixels: `motion` is that of a frame in uv units, the shutter is open for `shutter` frames, and the moment of
// the frame is its middle. A way is `longest` at most.
vec2 smear_of(vec2 motion, vec2 size, float shutter, float longest) {
    vec2 way = motion * size * shutter;
    float length_px = length(way);
    return length_px > longest ? way * (longest / length_px) : way;
}

// The part of another pixel's light that reaches a place so many pixels away: all of it within half of its own way. So
// nothing that stands still is drawn out over what moves behind it.
float smear_reaches(vec2 smear, float distance) {
    return clamp(0.5 * length(smear) + 1.0 - distance, 0.0, 1.0);
}
