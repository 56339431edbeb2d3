// Numbers from a table of blue noise; common/numerics/blue_noise.py has the same functions, bit for bit.

// The number in [0, 1) of a rank below 2^14 in a frame: (rank + 1/2) / 2^14 + frame * golden ratio, wrapped. Whole
// numbers wrap by themselves and lose no digits, however long a program runs.
float animated_rank(uint rank, uint frame) {
    uint turned = ((rank * 2u + 1u) << 17) + (frame & 255u) * 0x9E3779B9u;
    return float(turned >> 8) * (1.0 / 16777216.0);
}

// Two independent numbers in [0, 1) become one in [-1, 1), its density a triangle, its mean 0, its variance 1/6.
float triangular(vec2 numbers) {
    return numbers.x + numbers.y - 1.0;
}
