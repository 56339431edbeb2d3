// The buffer of a frame's shadows; shadows/layout.py says what is where. SHADOW_BLOCK is its number in set 0.

#include "shadows/records.glsl"

layout(BIND(0, SHADOW_BLOCK, 14), std430) readonly buffer Shadows_ {
    uint shadow_of[SHADOW_LIGHTS];          // by light: 0, or 1 + its first face, and its number of faces from bit 24 on
    uint shadow_drawn[SHADOW_FACES];        // the faces that this frame draws; layout.py says what is in a word
    uint shadow_lists[SHADOW_FACES];        // the lights that it culls for: first face, and number of faces from bit 24 on
    ShadowFace shadow_faces[SHADOW_FACES];
    uint shadow_table[];                    // by tile of a face: its place in the pages, in tiles; y from bit 16 on
};

uint drawn_face(uint number) { return shadow_drawn[number] & 0xfffu; }

// Where a texel of a face lies in the pages.
ivec2 page_texel(ShadowFace face, ivec2 texel) {
    texel += ivec2(face.ends.zw);
    ivec2 tile = texel >> SHADOW_TILE_LOG2;
    uint word = shadow_table[face.place.x + uint(tile.y) * face.place.y + uint(tile.x)];
    return (ivec2(word & 0xffffu, word >> 16) << SHADOW_TILE_LOG2) + (texel & ((1 << SHADOW_TILE_LOG2) - 1));
}
