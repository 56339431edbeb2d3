// The buffer of the light lists; clusters/model.py says what is where.

const uint LIST_LIGHTS = 0u;      // words of the header
const uint LIST_SET_WORDS = 1u;
const uint LIST_TILES_X = 2u;
const uint LIST_TILE_LOG2 = 3u;
const uint LIST_FIRST_BIN_CODE = 4u;

uint first_bound(uint lights) { return uint(LIST_HEADER) + lights; }
uint first_found(uint lights) { return first_bound(lights) + uint(LIST_BOUND) * lights; }
uint first_bin(uint lights) { return first_found(lights) + uint(LIST_BOUND) * lights; }
uint first_depth(uint lights) { return first_bin(lights) + uint(LIST_BINS); }
uint first_tile(uint lights, uint set_words) { return first_depth(lights) + uint(LIST_BINS) * set_words; }

// The highest bits of a depth ahead of the eye: exponent and mantissa, a piecewise linear logarithm.
uint depth_code(float depth) { return floatBitsToUint(max(depth, 0.0)) >> uint(23 - LIST_STEPS_LOG2); }

// The bin of a depth; what is nearer than the first bin or farther than the last one is in that one.
uint bin_of(float depth, uint first_code) {
    uint code = depth_code(depth);
    return code < first_code ? 0u : min(code - first_code, uint(LIST_BINS) - 1u);
}
