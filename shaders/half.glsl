// Rounding to half precision before a store. How a store rounds is the device's choice, and some cut: what is made in
// several steps, each stored, would grow darker with every one. A number that is a half already is stored as it is.

// The half nearest to each component, ties to even, for 0 <= value <= 65504.
vec3 nearest_half(vec3 value) {
    uvec3 bits = floatBitsToUint(value);
    vec3 rounded = uintBitsToFloat((bits + 0xfffu + ((bits >> 13) & 1u)) & ~0x1fffu);
    // Below 2^-14 halves are evenly spaced, 2^-24 apart.
    vec3 tiny = roundEven(value * 16777216.0) / 16777216.0;
    return mix(rounded, tiny, lessThan(value, vec3(6.103515625e-5)));
}
