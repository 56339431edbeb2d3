// Study compacted-indices: writes the commands of an instance, or copies the indices of its meshlets; one work group each.

#include "studies/meshlet_field/field.glsl"

layout(local_size_x = GROUP) in;

struct Command {
    uint index_count;
    uint instance_count;
    uint first_index;
    int vertex_offset;
    uint first_instance;
};

layout(BIND(0, 2, 1), std430) readonly buffer Meshlets_ { Meshlet meshlets[]; };
layout(BIND(0, 3, 2), std430) readonly buffer Places_ { uvec2 places[]; };
layout(BIND(0, 4, 3), std430) readonly buffer Sums_ { uvec2 sums[]; };
layout(BIND(0, 5, 4), std430) writeonly buffer Commands_ { Command commands[]; };
#if WAY == INDICES
layout(BIND(0, 6, 5), std430) readonly buffer Indices_ { uint indices[]; };
layout(BIND(0, 7, 6), std430) writeonly buffer Compacted_ { uint compacted[]; };
#endif

void main() {
    uint number = gl_WorkGroupID.x, local = gl_LocalInvocationIndex;
    uvec4 range = instances[number].range;
    uvec2 base = sums[number], total = sums[number + 1u] - base;
#if WAY == INDICES
    if (local == 0u && total.x > 0u) {
        commands[base.x] = Command(total.y, 1u, base.y, 0, number);
    }
    for (uint i = 0u; i < range.y; ++i) {
        uint place = places[range.z + i].y;
        if ((place & MARK) != 0u) {
            // All invocations copy a meshlet together, neighbours to neighbours.
            Meshlet meshlet = meshlets[range.x + i];
            uint to = base.y + (place & ~MARK), count = 3u * (meshlet.counts >> 8u);
            for (uint k = local; k < count; k += GROUP) {
                compacted[to + k] = indices[meshlet.first_index + k];
            }
        }
    }
#else
    for (uint i = local; i < range.y; i += GROUP) {
        uint place = places[range.z + i].x;
        if ((place & MARK) != 0u) {
            uint end = i + 1u;  // a run goes on up to a meshlet that is not drawn
            while (WAY == RUNS && end < range.y && (places[range.z + end].y & MARK) != 0u) {
                ++end;
            }
            Meshlet last = meshlets[range.x + end - 1u];
            uint first_index = meshlets[range.x + i].first_index;
            uint index_count = last.first_index + 3u * (last.counts >> 8u) - first_index;
            commands[base.x + (place & ~MARK)] = Command(index_count, 1u, first_index, 0, number);
        }
    }
#endif
}
