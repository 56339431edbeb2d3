// Random numbers by PCG with 32 bits of state, RXS-M-XS (O'Neill 2014, "PCG: A Family of Simple Fast Space-Efficient
// Statistically Good Algorithms for Random Number Generation"): a linear congruential step, and a permutation of its
// bits.
//
// Everything is whole numbers, so each device gets the same bits. The same functions are in
// tests/twins/random_numbers.py.

// The permutation alone, as a hash (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering"): different numbers have
// different hashes.
uint pcg_permuted(uint state) {
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

uint pcg_hash(uint x) { return pcg_permuted(x * 747796405u + 2891336453u); }

// The next 32 random bits. The result belongs to the state before the step; all 2^32 states follow one another in a
// circle.
uint pcg(inout uint state) {
    uint before = state;
    state = before * 747796405u + 2891336453u;
    return pcg_permuted(before);
}

// A state to begin with. In one frame all pixels (y * width + x below 2^32) have different ones, and so has one pixel
// in all frames. Two hashes of the frame and one of the pixel: with a plain sum, the next frame would be this one
// shifted.
uint seed_of(uvec2 pixel, uint width, uint frame) {
    return pcg_hash(pcg_hash(pixel.y * width + pixel.x) + pcg_hash(pcg_hash(frame)));
}

// The upper 24 bits as a number in [0, 1), on a grid of 2^-24 and never 1: all 32 bits would round to 1.0.
float unit_float(uint bits) { return float(bits >> 8u) * (1.0 / 16777216.0); }

// The next number in [0, 1).
float pcg_float(inout uint state) { return unit_float(pcg(state)); }
