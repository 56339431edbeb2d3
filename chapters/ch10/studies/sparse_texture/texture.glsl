// Study sparse-texture: what a tile holds, and a fetch that says whether there is memory, by the GPU or by a table.

#if SPARSE
#extension GL_ARB_sparse_texture2 : require
#endif

// Of each tile: its page in the pool, and the tile whose pattern it shows.
layout(BIND(0, 0, 0), std430) readonly buffer Tiles_ { uvec2 tiles[]; };
#if !SPARSE
layout(BIND(0, 1, 1), std430) POOL buffer Pool_ { uint pool[]; };
#endif

// The value of a texel, 8 bits for each channel: rings around the middle of the texture, in a colour of the tile.
uint pattern(uint content, ivec2 within) {
    ivec2 at = ivec2(content % uint(ACROSS), content / uint(ACROSS)) * TILE + within - TILE * ACROSS / 2;
    uint ring = uint(at.x * at.x + at.y * at.y) >> 10, bits = (content + 1u) * 2654435761u;
    uint bright = 128u + (ring % 8u) * 16u;
    if (any(lessThan(min(within, TILE - 1 - within), ivec2(3)))) {
        bright = 64u;
    }
    uvec3 hue = 60u + (uvec3(bits >> 8, bits >> 16, bits >> 24) & 127u) + uvec3(60, 40, 60);
    uvec3 color = hue * bright / 256u;
    return color.r | color.g << 8 | color.b << 16 | 0xff000000u;
}
