// How many task groups draw each batch, and in which layer of the target each face of a light lies. One work group for a
// batch, one invocation for a list: a round has no more lists than layers, at most 64.

#define SHADOW_BLOCK 0
#include "shadows/block.glsl"
#include "mesh_layers/rows.glsl"

layout(local_size_x = 64) in;

layout(BIND(0, 1, 5), std430) readonly buffer Numbers_ { uint numbers[]; };  // see shadows/cull.glsl
layout(BIND(0, 2, 6), std430) writeonly buffer Rows_ { uvec4 rows[]; };

struct Round {
    uvec4 first;  // x: the first layer and y: list of the round, z: layers of the round, w: of the target
    uvec4 sizes;  // x: lists, y: batches
};
PUSH(Round, pushed)

shared uint before[64];

void main() {
    uint me = gl_LocalInvocationIndex, batch = gl_WorkGroupID.x;
    bool listed = me < pushed.sizes.x;
    uvec4 row = uvec4(0u);
    for (uint layer = 0u; listed && layer < pushed.first.z; ++layer) {
        uint word = shadow_drawn[pushed.first.x + layer], face = word >> 12 & 15u;
        if ((word >> 16) - pushed.first.y == me && (row.w & 1u << face) == 0u) {
            row[1u + face / 4u] |= layer << (8u * (face & 3u));
            row.w |= 1u << face;
        }
    }
    uint units = listed && row.w != 0u ? numbers[(pushed.first.w + me) * pushed.sizes.y + batch] : 0u;
    uint groups = (units + TASK_ENTRIES - 1u) / TASK_ENTRIES;
    before[me] = groups;
    barrier();
    for (uint step = 1u; step < 64u; step *= 2u) {
        uint other = me >= step ? before[me - step] : 0u;
        barrier();
        before[me] += other;
        barrier();
    }
    row.x = before[me] - groups;
    if (listed) {
        rows[list_row(batch, pushed.first.w, me)] = row;
    }
    if (me == 63u) {
        uint all = before[me];  // every device takes 65535 groups along an axis
        rows[row_of(batch, pushed.first.w)] = uvec4(min(all, 65535u), (all + 65534u) / 65535u, 1u, all);
    }
}
