// Studies of meshlets: turns the sums of instances into the sums of all instances before each, with one work group.

layout(local_size_x = 256) in;

#include "studies/meshlet_field/sums.glsl"

layout(BIND(0, 0, 0), std430) buffer Sums_ { uvec2 sums[]; };  // one more than instances: the last is that of all
layout(BIND(0, 1, 1), std430) writeonly buffer Totals_ { uint totals[]; };  // commands, triangles

void main() {
    uint local = gl_LocalInvocationIndex;
    uint count = uint(sums.length()) - 1u;
    uvec2 seen = uvec2(0u);
    for (uint chunk = 0u; chunk < count; chunk += 256u) {
        uint i = chunk + local;
        uvec2 total;
        uvec2 before = sum_before(i < count ? sums[i] : uvec2(0u), total);
        if (i < count) {
            sums[i] = seen + before;
        }
        seen += total;
    }
    if (local == 0u) {
        sums[count] = seen;
        totals[0] = seen.x;
        totals[1] = seen.y / 3u;
    }
}
