// Study sine-hash: a number from 0 to 1 for a place, by a sine and by whole numbers.

// Known by its constants, and of unknown origin: fract(sin(dot(place, (12.9898, 78.233))) * 43758.5453), here with the angle
// brought below pi first. What the factor leaves are the digits from the fifth on, and for those no specification answers:
// Vulkan allows a sine an absolute error of 2^-11, and times 43758 that is 21 whole turns of `fract`. Nor is the angle exact:
// some compilers fuse the product with the sum.
float sine_hash(vec2 place) {
    float angle = mod(dot(place, vec2(12.9898, 78.233)), 3.14159265);
    return fract(sin(angle) * 43758.5453);
}

// Products of whole numbers modulo 2^32 are exact on every device. This is PCG (M. O'Neill 2014) as a hash of one number
// (M. Jarzynski, M. Olano 2020, "Hash Functions for GPU Rendering"), applied to x and then with y.
uint pcg(uint value) {
    uint state = value * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

float integer_hash(uvec2 place) {
    // 24 bits: as many as a float holds, so that 1 is never reached by rounding.
    return float(pcg(pcg(place.x) + place.y) >> 8u) * (1.0 / 16777216.0);
}
