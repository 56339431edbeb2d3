// Writes a draw command for each unit that is drawn, batch by batch in the order of the scene, and the number of commands
// of each batch.

#include "culling/lists.glsl"

void main() {
    uint number = group_number() * 256u + gl_LocalInvocationIndex;
    if (number < state[argument_word() + 3u]) {
        uvec2 place = places[number];
        if ((place.x & DRAWN) != 0u) {
            Draw draw = drawn_as(place.y);
            uvec4 batch = batches[draw.batch];
            uint position = drawn_before(number) - drawn_before(first_unit(batch.x));
            if (position < batch.z) {
                uint unit = number - first_unit(place.y);
                uint first = draw.first_index, indices = draw.index_count, offset = 0u;
#ifdef UNIT_CODE
                bool whole = (draw.flags & WHOLE) != 0u;
                offset = (whole ? phase() * 64u : unit_code(phase(), draw.first_meshlet + unit)) << 24;
#endif
                if ((draw.flags & WHOLE) == 0u) {
                    Meshlet meshlet = meshlets[draw.first_meshlet + unit];
                    first += meshlet.first_index;
                    indices = 3u * (meshlet.counts >> 8u);
                }
                // VkDrawIndexedIndirectCommand: indices, instances, first index, vertex offset, first instance
#ifdef INDEX_CODE
                offset = first - draws[place.y].first_index;
#endif
                uint word = 5u * (phase() * sizes.more.y + batch.y + position);
                commands[word] = indices;
                commands[word + 1u] = 1u;
                commands[word + 2u] = first;
                commands[word + 3u] = offset;
                commands[word + 4u] = draw.instance;
            }
        }
    }
    if (number < sizes.counts.y) {
        uvec4 batch = batches[number];
        uint next = number + 1u < sizes.counts.y ? batches[number + 1u].x : sizes.counts.x;
        uint drawn = drawn_before(first_unit(next)) - drawn_before(first_unit(batch.x));
        state[sizes.counts.w + phase() * sizes.counts.y + number] = min(drawn, batch.z);
        if (drawn > batch.z) {
            atomicAdd(state[phase() * COUNTER_WORDS + UNITS_DROPPED], drawn - batch.z);
        }
#ifdef MESH_SHADERS
        // VkDrawMeshTasksIndirectCommandEXT: groups of 32 meshlets, at most 65535 along an axis
        uint wanted = (first_units(next).x - first_units(batch.x).x + 31u) / 32u, groups = min(wanted, uint(MOST_TASKS));
        uint rows = (groups + 65534u) / 65535u;
        if (wanted > groups) {
            atomicAdd(state[phase() * COUNTER_WORDS + UNITS_DROPPED], 32u * (wanted - groups));
        }
        uint word = sizes.firsts.x + 4u * (phase() * sizes.counts.y + number);
        state[word] = rows > 1u ? 65535u : groups;
        state[word + 1u] = max(rows, 1u);
        state[word + 2u] = 1u;
#endif
    }
}
