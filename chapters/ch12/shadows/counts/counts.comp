// Adds up what a round draws of casters: a work group for each list and batch. Sums of integers do not depend on the order.
//
// An entry of a list is drawn to each of its faces that the round has, whether commands or mesh shaders do it.

#include "shadows/cull.glsl"
#include "culling/sums.glsl"

layout(BIND(0, 9, 11), std430) buffer Told_ {
    uint told[4];  // units in lists, draws, triangles: the low word and the high one
};

shared uint drawn_faces;

void main() {
    uint me = gl_LocalInvocationIndex, batch = gl_WorkGroupID.x, list = gl_WorkGroupID.y;
    if (pushed.sizes.y == 0u) {  // the frame begins
        if (me < 4u) {
            told[me] = 0u;
        }
        return;
    }
    if (me == 0u) {
        drawn_faces = 0u;
    }
    barrier();
    if (me < pushed.first.y) {
        uint word = shadow_drawn[pushed.first.x + me];
        if (word != SHADOW_NONE && (word >> 16) - pushed.first.x == list) {
            atomicOr(drawn_faces, 1u << (word >> 12 & 15u));
        }
    }
    barrier();
    uint units = numbers[units_number(list, batch)], from = place_of(list, batch), drawn = 0u, triangles = 0u;
    for (uint i = me; i < units; i += 256u) {
        uvec2 entry = lists[from + i];
        Draw draw = draws[entry.x];
        uint faces = uint(bitCount(entry.y >> 24 & drawn_faces)), indices = draw.index_count;
        if ((draw.flags & WHOLE) == 0u) {
            indices = 3u * (meshlets[draw.first_meshlet + (entry.y & 0xffffffu)].counts >> 8u);
        }
        drawn += faces;
        triangles += faces * (indices / 3u);
    }
    uvec2 all;
    sum_before(uvec2(drawn, triangles), all);
    if (me == 0u && units > 0u) {
        atomicAdd(told[0], units);
        atomicAdd(told[1], all.x);
        uint before = atomicAdd(told[2], all.y);
        if (before + all.y < before) {
            atomicAdd(told[3], 1u);
        }
    }
}
