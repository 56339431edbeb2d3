// Copies faces that were drawn into their pages: a layer of invocations for each face, one for eight texels of a column.
//
// What is stored is linear: metres along the axis of the face. Filters then compare and average lengths, and a face may
// lie in any tiles of the pages. Sizes of faces and of tiles are multiples of eight, so an invocation stays in one tile.

layout(local_size_x = 32, local_size_y = 4) in;

#define SHADOW_BLOCK 0
#include "shadows/block.glsl"

layout(BIND(0, 1, 16)) uniform sampler2DArray drawn;
layout(BIND(0, 2, 7), r32f) uniform writeonly image2D pages;

struct Round {
    uvec4 first;  // x: the first face of this round among those that the frame draws
};
PUSH(Round, pushed)

const int TEXELS = 8;

void main() {
    ShadowFace face = shadow_faces[drawn_face(pushed.first.x + gl_GlobalInvocationID.z)];
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy) * ivec2(1, TEXELS);
    if (any(greaterThanEqual(texel, ivec2(face.place.z)))) {
        return;
    }
    ivec2 to = page_texel(face, texel);
    for (int i = 0; i < TEXELS; ++i) {
        ivec2 at = texel + ivec2(0, i);
        float depth = texelFetch(drawn, ivec3(at + target_margin(face), gl_GlobalInvocationID.z), 0).r;
        imageStore(pages, to + ivec2(0, i), vec4(within_reach(face, at, linear_depth(face, depth))));
    }
}
