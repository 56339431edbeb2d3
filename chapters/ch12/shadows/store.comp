// Copies parts of faces that were drawn into pages: a slice of invocations for each copy of the round, one invocation for
// eight texels of a column.
//
// What is stored is linear: metres along the axis of the face. Filters then compare and average lengths, and a face may
// lie in any pages. Where movers were drawn, the page of all other casters is joined with them: the nearer depth counts.
// Sizes of faces and of tiles are multiples of eight, so an invocation stays inside of both.

layout(local_size_x = 32, local_size_y = 4) in;

#define SHADOW_BLOCK 0
#include "shadows/block.glsl"

layout(BIND(0, 1, 16)) uniform sampler2DArray drawn;
layout(BIND(0, 2, 7), r32f) uniform image2DArray pages;

struct Round {
    uvec4 number;  // x: of this round
};
PUSH(Round, pushed)

const int TEXELS = 8;

void main() {
    uint word = shadow_rounds[pushed.number.x].w + 4u * gl_GlobalInvocationID.z;
    // Layer and face, tile of the face, page, and page of other casters.
    uvec4 copied = uvec4(shadow_table[word], shadow_table[word + 1u], shadow_table[word + 2u], shadow_table[word + 3u]);
    ShadowFace face = shadow_faces[copied.x >> 16];
    ivec2 tile = ivec2(copied.y & 0xffffu, copied.y >> 16);
    ivec2 inside = ivec2(gl_GlobalInvocationID.xy) * ivec2(1, TEXELS);
    ivec2 texel = (tile << SHADOW_TILE_LOG2) + inside;
    if (any(greaterThanEqual(texel, ivec2(face.place.z)))) {
        return;
    }
    ivec3 at_page = ivec3(inside + ivec2(face.ends.zw), 0);
    ivec3 to = page_origin(copied.z) + at_page, from = page_origin(copied.w) + at_page;
    int layer = int(copied.x & 0xffffu);
    for (int i = 0; i < TEXELS; ++i) {
        ivec2 at = texel + ivec2(0, i);
        float depth = texelFetch(drawn, ivec3(at + target_margin(face), layer), 0).r;
        float metres = within_reach(face, at, linear_depth(face, depth));
        if (copied.w != SHADOW_NONE) {
            metres = min(metres, imageLoad(pages, from + ivec3(0, i, 0)).r);
        }
        imageStore(pages, to + ivec3(0, i, 0), vec4(metres));
    }
}
