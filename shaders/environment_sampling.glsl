// Directions towards the texels of a cube map, drawn by a table of aliases (alias.glsl), and their density.
//
// Texel x, y of a face has the number (face * size + y) * size + x. common/environment/importance.py computes the
// weights. Within a texel the points of its area are equally likely; the density per solid angle follows from how it is
// seen.

#include "environment.glsl"

// The number of the texel that direction `d` (not zero) meets, of a cube with `size` texels along an edge.
uint cube_texel_at(vec3 d, uint size) {
    uint face;
    vec2 uv = cube_uv(d, face);
    uvec2 texel = min(uvec2(clamp(uv, 0.0, 1.0) * float(size)), uvec2(size - 1u));
    return (face * size + texel.y) * size + texel.x;
}

// The unit direction through point `u` in [0, 1)^2 of texel `index`.
vec3 cube_texel_direction(uint index, uint size, vec2 u) {
    uint row = index / size;
    uvec2 texel = uvec2(index % size, row % size);
    return normalize(cube_direction(row / size, (vec2(texel) + u) / float(size)));
}

// The density per solid angle of unit direction `d`, whose texel is chosen with `probability`.
float cube_texel_pdf(float probability, vec3 d, uint size) {
    return probability / cube_texel_solid_angle(d, float(size));
}
