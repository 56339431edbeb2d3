// Studies of meshlets: tests the meshlets of an instance, one work group for each, and gives survivors their places.
//
// A place has two parts, both within the instance: the commands before the unit, and the indices before it.

#include "studies/meshlet_field/field.glsl"

layout(local_size_x = GROUP) in;

#include "studies/meshlet_field/sums.glsl"

layout(BIND(0, 2, 1), std430) readonly buffer Meshlets_ { Meshlet meshlets[]; };
layout(BIND(0, 3, 2), std430) writeonly buffer Places_ { uvec2 places[]; };  // of each unit
layout(BIND(0, 4, 3), std430) writeonly buffer Sums_ { uvec2 sums[]; };  // of each instance

shared bool drawn[GROUP];

void main() {
    uint number = gl_WorkGroupID.x, local = gl_LocalInvocationIndex;
    Instance instance = instances[number];
    uint first = instance.range.x, count = instance.range.y, first_unit = instance.range.z;
    uvec2 seen = uvec2(0u);
    bool last = false;  // whether the last meshlet of the chunk before is drawn
    for (uint chunk = 0u; chunk < count; chunk += GROUP) {
        uint i = chunk + local, indices = 0u;
        drawn[local] = false;
        if (i < count) {
            Meshlet meshlet = meshlets[first + i];
            drawn[local] = is_visible(instance, meshlet);
            indices = drawn[local] ? 3u * (meshlet.counts >> 8u) : 0u;
        }
        barrier();
        bool follows = local > 0u ? drawn[local - 1u] : last;
        bool begins = drawn[local] && (WAY == COMMANDS || !follows);
        last = drawn[GROUP - 1u];
        uvec2 total;
        uvec2 place = seen + sum_before(uvec2(uint(begins), indices), total);
        if (i < count) {
            places[first_unit + i] = place | uvec2(begins ? MARK : 0u, drawn[local] ? MARK : 0u);
        }
        seen += total;
    }
    if (local == 0u) {
        sums[number] = uvec2(WAY == INDICES ? min(seen.x, 1u) : seen.x, seen.y);
    }
}
