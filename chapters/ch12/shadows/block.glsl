// The buffer of a frame's shadows; shadows/layout.py says what is where. SHADOW_BLOCK is its number in set 0.

#include "shadows/records.glsl"

layout(BIND(0, SHADOW_BLOCK, 14), std430) readonly buffer Shadows_ {
    uint shadow_of[SHADOW_LIGHTS];          // by light: 0, or 1 + its first face, and its number of faces from bit 24 on
    uint shadow_drawn[4 * SHADOW_FACES];    // by layer of the rounds: the face that is drawn to it
    uint shadow_lists[4 * SHADOW_FACES];    // the lights to cull for: first face, and number of faces from bit 24 on
    uint shadow_blended[SHADOW_BLENDED];    // a bit for each material that is blended
    uint shadow_moving[SHADOW_MOVING];      // a bit for each instance that is a mover
    uvec4 shadow_rounds[2 * SHADOW_FACES];  // xyz: work groups of the copy of a round, w: the first word of its first copy
    uvec4 shadow_asks[3];                   // xyz: work groups of the passes that report
    vec4 shadow_filter;                     // bias in texels: x constant, y by slope; sizes: z of lamps, in length scales, w of suns, as a tangent
    ivec4 shadow_places[2];                 // model.place_words: page_table/report.glsl and shadows/cull.glsl read them
    ShadowFace shadow_faces[SHADOW_FACES];
    uint shadow_table[];                    // by tile of a face: its place in the pages, in tiles; then the copies
};

const uint SHADOW_NONE = 0xffffffffu;    // no face, or no page
const uint SHADOW_COPIED = 0x80000000u;  // of a page: the frame draws it

uint drawn_face(uint number) { return shadow_drawn[number] & 0xfffu; }

// The first texel of a page, and its layer; `word` is of the table.
ivec3 page_origin(uint word) {
    return ivec3(ivec2(word & 0xffu, word >> 8 & 0xffu) << SHADOW_TILE_LOG2, int(word >> 16 & 0x7fffu));
}

uint page_word(ShadowFace face, ivec2 tile) {
    return shadow_table[face.place.x + uint(tile.y) * face.place.y + uint(tile.x)];
}

// Where a texel of a face lies in the pages.
ivec3 page_texel(ShadowFace face, ivec2 texel) {
    texel += ivec2(face.ends.zw);
    ivec3 origin = page_origin(page_word(face, texel >> SHADOW_TILE_LOG2));
    return origin + ivec3(texel & ((1 << SHADOW_TILE_LOG2) - 1), 0);
}

// Whether all texels between two corners of a face, at most a tile apart, have memory.
bool is_resident(ShadowFace face, ivec2 low, ivec2 high) {
    ivec2 most = ivec2(int(face.place.z) - 1), from = ivec2(face.ends.zw);
    if (most.x < 0) {
        return false;  // the light has no such face
    }
    low = (clamp(low, ivec2(0), most) + from) >> SHADOW_TILE_LOG2;
    high = (clamp(high, ivec2(0), most) + from) >> SHADOW_TILE_LOG2;
    bool held = page_word(face, low) != SHADOW_NONE;
    if (low != high) {
        held = held && page_word(face, high) != SHADOW_NONE && page_word(face, ivec2(low.x, high.y)) != SHADOW_NONE
            && page_word(face, ivec2(high.x, low.y)) != SHADOW_NONE;
    }
    return held;
}
