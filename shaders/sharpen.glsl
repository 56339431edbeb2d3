// Sharpening: the difference between a pixel's luminance and the mean around it becomes larger, and the hue stays.

// The factor by which a colour is multiplied: L' / L with L' = L + (L - mean) amount, where `mean` is that of the 3x3
// pixels around and at this one.
//
// L' is at most (1 + amount) L, since no mean is below 0. The same bound holds downwards: in linear light the mean beside a
// lamp exceeds L many times, L' would be negative, and each lamp would have a black ring. Black stays black.
float sharpening(float luminance, float mean, float amount) {
    if (!(luminance > 0.0)) {
        return 1.0;
    }
    return clamp((luminance + (luminance - mean) * amount) / luminance, 1.0 / (1.0 + amount), 1.0 + amount);
}
