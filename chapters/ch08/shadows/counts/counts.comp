// Adds up what a round draws of casters: a work group for each face and batch. Sums of integers do not depend on the order.

#include "culling/sums.glsl"

layout(local_size_x = 256) in;

layout(BIND(0, 0, 5), std430) readonly buffer Batches_ { uvec4 batches[]; };    // y: the first place
layout(BIND(0, 1, 6), std430) readonly buffer Numbers_ { uint numbers[]; };     // as in shadows/cull.glsl
layout(BIND(0, 2, 7), std430) readonly buffer Commands_ { uint commands[]; };   // 5 words each
layout(BIND(0, 3, 8), std430) buffer Told_ {
    uint told[4];  // units in lists, draws, triangles: the low word and the high one
};

struct Counted {
    uvec4 round;  // x: places of a face, y: layers, z: batches, w: lists; nothing but 0: the frame begins
};
PUSH(Counted, pushed)

void main() {
    uint me = gl_LocalInvocationIndex, batch = gl_WorkGroupID.x, layer = gl_WorkGroupID.y;
    if (pushed.round.z == 0u) {
        if (me < 4u) {
            told[me] = 0u;
        }
        return;
    }
    uint draws = numbers[layer * pushed.round.z + batch], first = layer * pushed.round.x + batches[batch].y, mine = 0u;
    for (uint i = me; i < draws; i += 256u) {
        mine += commands[5u * (first + i)] / 3u;
    }
    uvec2 all;
    sum_before(uvec2(mine, 0u), all);
    if (me == 0u && layer < pushed.round.w) {
        atomicAdd(told[0], numbers[(pushed.round.y + layer) * pushed.round.z + batch]);
    }
    if (me == 0u && draws > 0u) {
        atomicAdd(told[1], draws);
        uint before = atomicAdd(told[2], all.x);
        if (before + all.x < before) {
            atomicAdd(told[3], 1u);
        }
    }
}
