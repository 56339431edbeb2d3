// The random numbers of a path: independent ones, or with PATH_SOBOL points of a sequence that covers the square evenly.
//
// Each use has a pair of dimensions of its own (see `PAIR_*`): the lens and each reflection begin at a fixed one.

#include "paths/frame.glsl"
#include "sobol.glsl"

const uint PAIR_PIXEL = 0u;
const uint PAIR_BOUNCE = 2u;  // the first one of a reflection, behind those of the pixel and of the lens
const uint PAIRS = 5u;        // pairs of a reflection

struct Random {
    uint state;  // of PCG
    uint index;  // number of the path in its pixel
    uint seed;   // of the pixel
    uint pair;   // the next pair of dimensions
};

Random random_of(uvec2 pixel, uint width, uint number, uint seed) {
    uint place = pcg_hash(pixel.y * width + pixel.x + pcg_hash(seed));
    return Random(seed_of(pixel, width, number + pcg_hash(seed)), number, place, PAIR_PIXEL);
}

uvec2 random_bits(inout Random random) {
    if ((path.knobs.w & PATH_SOBOL) != 0u) {
        return sobol_bits(random.index, random.pair++, random.seed);
    }
    uint first = pcg(random.state);
    return uvec2(first, pcg(random.state));
}

vec2 random_2d(inout Random random) {
    uvec2 bits = random_bits(random);
    return vec2(unit_float(bits.x), unit_float(bits.y));
}
