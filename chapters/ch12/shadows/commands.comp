// The draw commands of each face: a work group for each face of the round and each batch, which takes from the list of its
// light what the face can see.

#include "shadows/cull.glsl"
#include "culling/sums.glsl"
#include "mesh_layers/rows.glsl"

void main() {
    uint me = gl_LocalInvocationIndex, batch = gl_WorkGroupID.x, layer = gl_WorkGroupID.y;
    uint word = shadow_drawn[pushed.first.x + layer], bit = 1u << (24u + (word >> 12 & 15u));
    bool empty = word == SHADOW_NONE;
    uint list = empty ? 0u : (word >> 16) - pushed.first.x, kept = 0u;
    uint units = empty ? 0u : numbers[units_number(list, batch)];
    uint from = place_of(list, batch), to = place_of(layer, batch);
    for (uint begin = 0u; begin < units; begin += 256u) {
        uvec2 entry = begin + me < units ? lists[from + begin + me] : uvec2(0u);
        bool drawn = (entry.y & bit) != 0u;
        drawn = drawn && (draws[entry.x].flags & BY_MESH_SHADERS) == 0u;
        uvec2 total;
        uint position = kept + sum_before(uvec2(drawn ? 1u : 0u, 0u), total).x;
        kept += total.x;
        if (drawn) {
            Draw draw = draws[entry.x];
            uint first = draw.first_index, indices = draw.index_count;
            if ((draw.flags & WHOLE) == 0u) {
                Meshlet meshlet = meshlets[draw.first_meshlet + (entry.y & 0xffffffu)];
                first += meshlet.first_index;
                indices = 3u * (meshlet.counts >> 8u);
            }
            // VkDrawIndexedIndirectCommand: indices, instances, first index, vertex offset, first instance
            uint at = 5u * (to + position);
            commands[at] = indices;
            commands[at + 1u] = 1u;
            commands[at + 2u] = first;
            commands[at + 3u] = 0u;
            commands[at + 4u] = draw.instance;
        }
    }
#ifdef CLEARED  // the device takes no number of draws from a buffer, and draws all of them
    for (uint position = kept + me; position < batches[batch].z; position += 256u) {
        commands[5u * (to + position) + 1u] = 0u;
    }
#endif
    if (me == 0u) {
        numbers[commands_number(layer, batch)] = kept;
    }
}
