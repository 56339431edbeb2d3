// Colours for numbers that are no light: heat for how many, a hue drawn by lot for which one. `common/images/palette.py` is
// the same in numpy. What comes out is shown as it is, without an sRGB curve.

// Black, blue, cyan, green, yellow, red, white, evenly spaced over t from 0 to 1; beyond, the ends.
vec3 heat(float t) {
    float x = 6.0 * clamp(t, 0.0, 1.0);
    // Each channel rises and falls in straight lines between the seven colours.
    float r = clamp(x - 3.0, 0.0, 1.0);
    float g = clamp(x - 1.0, 0.0, 1.0) - clamp(x - 4.0, 0.0, 1.0) + clamp(x - 5.0, 0.0, 1.0);
    float b = clamp(x, 0.0, 1.0) - clamp(x - 2.0, 0.0, 1.0) + clamp(x - 5.0, 0.0, 1.0);
    return vec3(r, g, b);
}

// A hash whose every output bit depends on every input bit: PCG with one permutation step (Jarzynski and Olano 2020).
uint scrambled(uint value) {
    uint state = value * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28) + 4u)) ^ state) * 277803737u;
    return (word >> 22) ^ word;
}

// A colour for an id, never black: hue, saturation and brightness from different bits of its hash.
vec3 id_color(uint id) {
    uint bits = scrambled(id);
    float hue = float(bits & 0xffffu) * (6.0 / 65536.0);
    float saturation = 0.5 + 0.5 * float((bits >> 16) & 0xffu) / 255.0;
    float brightness = 0.6 + 0.4 * float(bits >> 24) / 255.0;
    vec3 pure = clamp(abs(mod(hue + vec3(0.0, 4.0, 2.0), 6.0) - 3.0) - 1.0, 0.0, 1.0);
    return brightness * mix(vec3(1.0), pure, saturation);
}

// One id for a part of an object: equal parts of different objects differ.
uint part_id(uint object, uint part) {
    return part ^ scrambled(object);
}
