// Copies faces that were drawn into their pages: a layer of invocations for each face, one for each texel.
//
// What is stored is linear: metres along the axis of the face. Filters then compare and average lengths, and a face may
// lie in any tiles of the pages.

layout(local_size_x = 16, local_size_y = 16) in;

#define SHADOW_BLOCK 0
#include "shadows/block.glsl"

layout(BIND(0, 1, 16)) uniform sampler2DArray drawn;
layout(BIND(0, 2, 7), r32f) uniform writeonly image2D pages;

struct Round {
    uvec4 first;  // x: the first face of this round among those that the frame draws
};
PUSH(Round, pushed)

void main() {
    ShadowFace face = shadow_faces[drawn_face(pushed.first.x + gl_GlobalInvocationID.z)];
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (all(lessThan(texel, ivec2(face.place.z)))) {
        float depth = texelFetch(drawn, ivec3(gl_GlobalInvocationID), 0).r;
        imageStore(pages, page_texel(face, texel), vec4(within_reach(face, texel, linear_depth(face, depth))));
    }
}
