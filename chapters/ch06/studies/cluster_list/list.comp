// Study cluster-list: lists the surviving meshlets of an instance, one work group each, and writes the arguments of draws.

#include "studies/meshlet_field/field.glsl"

layout(local_size_x = GROUP) in;

layout(BIND(0, 2, 1), std430) readonly buffer Places_ { uvec2 places[]; };
layout(BIND(0, 3, 2), std430) readonly buffer Sums_ { uvec2 sums[]; };
layout(BIND(0, 4, 3), std430) writeonly buffer List_ {
    uvec2 list[];  // instance, meshlet
};
layout(BIND(0, 5, 4), std430) writeonly buffer Arguments_ {
    uvec4 arguments[];  // VkDrawMeshTasksIndirectCommandEXT of each draw
};

void main() {
    uint number = gl_WorkGroupID.x, local = gl_LocalInvocationIndex;
    uvec4 range = instances[number].range;
    for (uint i = local; i < range.y; i += GROUP) {
        uint place = places[range.z + i].x;
        if ((place & MARK) != 0u) {
            list[sums[number].x + (place & ~MARK)] = uvec2(number, range.x + i);
        }
    }
    uint all = sums[sums.length() - 1].x;
    for (uint draw = gl_GlobalInvocationID.x; draw < uint(arguments.length()); draw += gl_NumWorkGroups.x * GROUP) {
        uint left = all - min(draw * AT_ONCE, all);
        arguments[draw] = uvec4(min(left, AT_ONCE), 1u, 1u, 0u);
    }
}
