// Study any-hit-alpha: whether there is leaf where a ray meets a card. Every way of tracing asks `accept`.

#include "rays/ray.glsl"

layout(BIND(0, 2, 2), std430) buffer Counts_ { uint counts[]; };  // zero when the frame begins
layout(BIND(0, 3, 3), std430) readonly buffer Mask_ { uint mask_words[]; };

// Where a hit lies on its card: two triangles, of corners 0, 1, 2 and 0, 2, 3.
vec2 uv_of(Hit hit) {
    return (hit.primitive & 1u) == 0u ? vec2(hit.at.x + hit.at.y, hit.at.y) : vec2(hit.at.x, hit.at.x + hit.at.y);
}

bool accept(Hit hit) {
    uvec2 texel = uvec2(clamp(uv_of(hit) * float(TEXELS), 0.0, float(TEXELS) - 1.0));
    uint bit = texel.y * uint(TEXELS) + texel.x;
    bool leaf = (mask_words[bit >> 5] >> (bit & 31u) & 1u) != 0u;
    atomicAdd(counts[0], 1u);
    if (!leaf) {
        atomicAdd(counts[1], 1u);
    }
    return leaf;
}
