// Unit vectors as two numbers from -1 to 1: the sphere is projected onto an octahedron, which unfolds into a square
// (Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014, listing 1).
//
// The upper half is the inner diamond of the square; the four triangles of the lower half fold outward over its edges.

vec2 sign_not_zero(vec2 v) { return vec2(v.x >= 0.0 ? 1.0 : -1.0, v.y >= 0.0 ? 1.0 : -1.0); }

// Returns (0, 0) for a vector without a length, which decodes to +z.
vec2 octahedral_from_unit(vec3 n) {
    float sum = abs(n.x) + abs(n.y) + abs(n.z);
    vec2 p = sum > 0.0 ? n.xy / sum : vec2(0.0);
    return n.z < 0.0 ? (1.0 - abs(p.yx)) * sign_not_zero(p) : p;
}

vec3 unit_from_octahedral(vec2 code) {
    vec3 n = vec3(code, 1.0 - abs(code.x) - abs(code.y));
    float below = max(-n.z, 0.0);
    n.xy -= below * sign_not_zero(n.xy);
    return normalize(n);
}
