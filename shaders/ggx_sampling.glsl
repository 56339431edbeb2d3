// Sampling of the GGX distribution in proportion to what is seen of it, and of the cosine.
//
// Directions are local: the surface's normal is +z. Numbers `u` are uniform in the unit square. The same functions in
// float64, and why they are right, are in tests/twins/ggx_sampling.py.

#include "brdf.glsl"

// Two unit vectors that make a right-handed frame with unit `n` as its z axis (Duff et al. 2017, "Building an
// Orthonormal Basis, Revisited"): no branch that could fail at a pole.
mat3 frame_around(vec3 n) {
    float s = n.z < 0.0 ? -1.0 : 1.0;
    float a = -1.0 / (s + n.z);
    float b = n.x * n.y * a;
    return mat3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

// A direction with the density cosine / pi, the disc by its polar coordinates (Malley's method).
vec3 sample_cosine(vec2 u) {
    float phi = 2.0 * PI * u.x;
    return vec3(sqrt(u.y) * vec2(cos(phi), sin(phi)), sqrt(1.0 - u.y));
}

// A microfacet normal h, with the density by which unit `v` (v.z >= 0) sees them: G1(v) (v.h) D(h) / v.z.
// Stretched by 1 / alpha the facets are those of a hemisphere, and what `v` sees of it is reflected from a spherical
// cap (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps"). Seen from straight above, v = +z,
// the density is D(h) h.z.
vec3 sample_ggx(vec2 u, vec3 v, float alpha) {
    vec3 stretched = normalize(vec3(v.xy * alpha, v.z));
    float phi = 2.0 * PI * u.x;
    float z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    vec3 cap = vec3(sqrt(clamp(1.0 - z * z, 0.0, 1.0)) * vec2(cos(phi), sin(phi)), z);
    vec3 h = cap + stretched;
    return normalize(vec3(h.xy * alpha, max(h.z, 0.0)));
}

// The part of the facets facing a direction that it really sees, of Smith's masking: G1 with cosine >= 0.
float masking_ggx(float cosine, float alpha) {
    float a2 = alpha * alpha;
    float sum = cosine + sqrt(a2 + (1.0 - a2) * cosine * cosine);
    return sum > 0.0 ? 2.0 * cosine / sum : 0.0;
}

// The density, per solid angle, of v mirrored at the h of `sample_ggx`, given D(h): G1(v) D / (4 v.z), finite at v.z = 0.
float pdf_ggx(float d, float n_dot_v, float alpha) {
    float a2 = alpha * alpha;
    return 0.5 * d / (n_dot_v + sqrt(a2 + (1.0 - a2) * n_dot_v * n_dot_v));
}
