// Each pixel is lit near the middle of the picture, where the eye looks: foveated rendering.

bool needs_all(ivec2 texel, ivec2 pixel, ivec2 lit) {
    vec2 away = (vec2(pixel) + 0.5 - 0.5 * frame.size.xy) * frame.size.w;
    return dot(away, away) <= RADIUS * RADIUS;
}
