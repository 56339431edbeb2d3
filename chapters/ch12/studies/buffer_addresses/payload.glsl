// What a ray brings back.

struct Fetched {
    vec4 color;  // linear; w: t, or -1
    uvec4 what;  // instance, triangle, a sum over the bits of three positions, and by how many metres these miss the hit
};
