// Study types-16bit: half precision in words of 32 bits. IEEE 754 binary16: a sign, 5 bits of exponent, 10 of fraction.

// The value of the lower 16 bits; exact.
float half_value(uint bits) {
    uint sign = (bits & 0x8000u) << 16, exponent = bits >> 10 & 31u, fraction = bits & 1023u;
    if (exponent == 0u) {  // subnormal: a multiple of 2^-24
        float value = float(fraction) * (1.0 / 16777216.0);
        return sign != 0u ? -value : value;
    }
    return uintBitsToFloat(sign | (exponent == 31u ? 0x7f800000u : (exponent + 112u) << 23) | fraction << 13);
}

// The bits of the half that is nearest to a value, ties to even.
uint half_bits(float value) {
    uint bits = floatBitsToUint(value), sign = bits >> 16 & 0x8000u;
    bits &= 0x7fffffffu;
    if (bits > 0x7f800000u) {
        return sign | 0x7e00u;  // not a number
    }
    if (bits >= 0x47800000u) {
        return sign | 0x7c00u;  // from 2^16 on, infinity; 65520 and more become it by the carry below
    }
    if (bits < 0x38800000u) {
        // Below 2^-14. The last place of numbers from 1/2 to 1 is 2^-24: adding 1/2 rounds to a multiple of that.
        precise float shifted = uintBitsToFloat(bits) + 0.5;
        return sign | (floatBitsToUint(shifted) - 0x3f000000u);
    }
    // Exponent: 127 - 15 less. Half of the last place less one, and one more if the last place is odd: ties go to even.
    return sign | ((bits - 0x38000000u + 0xfffu + (bits >> 13 & 1u)) >> 13);
}
