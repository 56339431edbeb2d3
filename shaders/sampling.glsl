// Points that fill the unit square evenly; common/numerics/sampling.py has the same functions, bit for bit.

// The bits of `index` mirrored at the binary point, in [0, 1). The upper 24 mirrored bits are all that a float holds;
// rounding the other eight would be the device's choice, and could give 1.0.
float radical_inverse_2(uint index) {
    return float(bitfieldReverse(index) >> 8) * (1.0 / 16777216.0);
}

// Point `index` of a Hammersley set; `inverse_count` = 1 / count, with at most 2^22 points.
vec2 hammersley(uint index, float inverse_count) {
    return vec2(float(index) * inverse_count, radical_inverse_2(index));
}
