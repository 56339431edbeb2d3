// Points of Sobol's sequence in two dimensions, in shuffled order and scrambled as Owen does it (Burley 2020, "Practical
// Hash-based Owen Scrambling", JCGT 9(4)).
//
// Any 2^m points from a multiple of 2^m on are a (0, m, 2)-net: each of the rectangles of area 2^-m into which halving
// cuts the unit square has one of them. Further pairs of dimensions are the same points in another order, scrambled
// otherwise. The same functions, made from tables of direction numbers, are in tests/twins/random_numbers.py.

#include "pcg.glsl"

// A nested uniform scramble of a number whose lowest bit counts most: each bit is flipped or not as the bits below it
// and the seed say. Only steps that carry bits upwards may be used. (Laine and Karras 2011, with the constants of
// Vegdahl 2021, "Building a Better LK Hash".)
uint scrambled_from_below(uint x, uint seed) {
    x ^= x * 0x3D20ADEAu;
    x += seed;
    x *= (seed >> 16u) | 1u;
    x ^= x * 0x05526C56u;
    x ^= x * 0x53A22864u;
    return x;
}

// The second dimension of Sobol's sequence before its bits are mirrored. Bit j is the sum modulo 2 of all bits k of the
// index with odd binomial (k over j), which is so where j has no bit that k lacks (Lucas). Hence five steps, one for
// each bit of k.
uint pascal_modulo_2(uint x) {
    x ^= (x & 0xAAAAAAAAu) >> 1u;
    x ^= (x & 0xCCCCCCCCu) >> 2u;
    x ^= (x & 0xF0F0F0F0u) >> 4u;
    x ^= (x & 0xFF00FF00u) >> 8u;
    return x ^ (x >> 16u);
}

// Point `index` of pair `dimension_pair` as two numbers of 32 bits, the highest bit worth 1/2.
uvec2 sobol_bits(uint index, uint dimension_pair, uint seed) {
    uint own = pcg_hash(seed + pcg_hash(dimension_pair));
    uint shuffled = bitfieldReverse(scrambled_from_below(bitfieldReverse(index), own));
    uint x = scrambled_from_below(shuffled, pcg_hash(own ^ 0x68BC21EBu));
    uint y = scrambled_from_below(pascal_modulo_2(shuffled), pcg_hash(own ^ 0x02E5BE93u));
    return uvec2(bitfieldReverse(x), bitfieldReverse(y));
}

// The point in [0, 1)^2.
vec2 sobol_2d(uint index, uint dimension_pair, uint seed) {
    uvec2 bits = sobol_bits(index, dimension_pair, seed);
    return vec2(unit_float(bits.x), unit_float(bits.y));
}
