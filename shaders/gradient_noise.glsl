// Gradient noise that tiles (Perlin 2002, "Improving Noise"), its gradients from a hash in place of a table.
//
// Whole numbers decide about gradients, so every device takes the same. The same in float64: tests/twins/noise.py.

// Three words from three (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering": pcg3d).
uvec3 pcg3d(uvec3 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> 16u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// The product of `offset` with the gradient at a corner of the lattice: one of the twelve from a cube's centre to the
// middles of its edges, four of them twice.
float gradient_product(ivec3 corner, uint period, uint seed, vec3 offset) {
    uvec3 wrapped = uvec3(corner) & (period - 1u);
    uint choice = pcg3d(wrapped + uvec3(0u, 0u, seed * 0x9E3779B9u)).x >> 28;
    float a = choice < 8u ? offset.x : offset.y;
    float b = choice < 4u ? offset.y : choice == 12u || choice == 14u ? offset.x : offset.z;
    return ((choice & 1u) == 0u ? a : -a) + ((choice & 2u) == 0u ? b : -b);
}

// Noise of about -1 to 1 at a point in units of the lattice, 0 at its corners; it repeats after `period` in every axis,
// which is a power of two.
float gradient_noise(vec3 point, uint period, uint seed) {
    vec3 whole = floor(point);
    ivec3 corner = ivec3(whole);
    vec3 f = point - whole;
    vec3 t = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    float planes[2];
    for (int z = 0; z < 2; z++) {
        float lines[2];
        for (int y = 0; y < 2; y++) {
            float near = gradient_product(corner + ivec3(0, y, z), period, seed, f - vec3(0, y, z));
            float far = gradient_product(corner + ivec3(1, y, z), period, seed, f - vec3(1, y, z));
            lines[y] = near + (far - near) * t.x;
        }
        planes[z] = lines[0] + (lines[1] - lines[0]) * t.y;
    }
    return planes[0] + (planes[1] - planes[0]) * t.z;
}

// Octaves of noise over coordinates uvw, which repeat after 1: each has twice the frequency of the one before, and half
// the weight. Mapped to 0..1 with mean one half; `frequency`, of the first octave, is a power of two.
float octaves_of_noise(vec3 uvw, uint frequency, int octaves, uint seed) {
    float total = 0.0, weights = 0.0, weight = 1.0;
    for (int octave = 0; octave < octaves; octave++) {
        total += weight * gradient_noise(uvw * float(frequency), frequency, seed + uint(octave));
        weights += weight;
        weight *= 0.5;
        frequency *= 2u;
    }
    return clamp(0.5 + 0.5 * total / weights, 0.0, 1.0);
}
