// Reconstruction filters: the weight of a sample at `offset` pixels from the centre of the pixel that is computed.
// All are products of the same function of both axes, are not normalised, and are 0 beyond their radius.
// FILTER chooses the one of sample_weight.

float tent_1d(float x) {
    return max(1.0 - abs(x), 0.0);
}

// Mitchell and Netravali 1988, "Reconstruction filters in computer graphics", with B = C = 1/3; radius 2.
float mitchell_1d(float x) {
    x = min(abs(x), 2.0);
    float outside = 2.0 - x;
    return (x < 1.0 ? x * x * (21.0 * x - 36.0) + 16.0 : outside * outside * (8.0 - 7.0 * x)) / 18.0;
}

// The window of four terms of Harris 1978, "On the use of windows for harmonic analysis with the discrete Fourier
// transform" (minimum, -92 dB), over a radius of 1.5. Cosines of multiples are written as powers of one cosine.
float blackman_harris_1d(float x) {
    float c = cos(abs(x) * (3.14159265358979 / 1.5));
    return abs(x) < 1.5 ? 0.21747 + c * (0.45325 + c * (0.28256 + c * 0.04672)) : 0.0;
}

// Catmull and Rom 1974; the family of Mitchell and Netravali with B = 0, C = 1/2. Radius 2. It interpolates: 1 at 0, and
// 0 at the other whole distances.
float catmull_rom_1d(float x) {
    x = min(abs(x), 2.0);
    float outside = 2.0 - x;
    return x < 1.0 ? x * x * (1.5 * x - 2.5) + 1.0 : 0.5 * outside * outside * (1.0 - x);
}

float tent(vec2 offset) { return tent_1d(offset.x) * tent_1d(offset.y); }

float mitchell(vec2 offset) { return mitchell_1d(offset.x) * mitchell_1d(offset.y); }

float blackman_harris(vec2 offset) { return blackman_harris_1d(offset.x) * blackman_harris_1d(offset.y); }

float catmull_rom_weight(vec2 offset) { return catmull_rom_1d(offset.x) * catmull_rom_1d(offset.y); }

#ifdef FILTER
float sample_weight(vec2 offset) {
#if FILTER == 0
    // Samples have a distance of one pixel, so exactly one of them lies in this square, which lacks two of its sides.
    return all(greaterThan(offset, vec2(-0.5))) && all(lessThanEqual(offset, vec2(0.5))) ? 1.0 : 0.0;
#elif FILTER == 1
    return tent(offset);
#elif FILTER == 2
    return mitchell(offset);
#elif FILTER == 3
    return blackman_harris(offset);
#else
    return catmull_rom_weight(offset);
#endif
}
#endif
