// The expected cost of a ray that meets the root's box (the surface area heuristic, as in build.py): a node and a triangle
// cost one each, times the share of the root's surface that their box has. A refitted mesh is due for a rebuild when this
// has risen. One work group, sums in one order: the figure is the same on every run.

layout(local_size_x = 256) in;

struct Push {
    uvec4 run;  // x: the root, which is the first of y nodes; z: where the cost is written
};
PUSH(Push, push)

#define BVH_WRITTEN 1
#define RAYS_SET 0
#define RAYS_BINDING 0
#include "rays/bvh/records.glsl"
layout(BIND(0, 3, 3), std430) buffer Costs_ { float costs[]; };

shared float sums[256];

float area(vec3 low, vec3 high) {
    vec3 size = max(high - low, 0.0);
    return size.x * size.y + size.y * size.z + size.z * size.x;
}

// Lengths are in units of the root's largest edge, so that no square leaves the range of numbers.
float child_cost(uint at, float unit) {
    uint code = floatBitsToUint(bvh_nodes[at].w);
    float count = code == BVH_NO_CHILD ? 0.0 : (code & BVH_LEAF) != 0u ? float((code >> BVH_COUNT_SHIFT & 3u) + 1u) : 1.0;
    return count > 0.0 ? count * area(bvh_nodes[at].xyz / unit, bvh_nodes[at + 1u].xyz / unit) : 0.0;
}

void main() {
    uint me = gl_LocalInvocationIndex, root = 4u * push.run.x;
    vec3 low = min(bvh_nodes[root].xyz, bvh_nodes[root + 2u].xyz);
    vec3 high = max(bvh_nodes[root + 1u].xyz, bvh_nodes[root + 3u].xyz);
    vec3 size = high - low;
    float unit = max(size.x, max(size.y, size.z)), sum = 0.0;
    for (uint node = me; node < push.run.y; node += 256u) {
        uint at = 4u * (push.run.x + node);
        sum += child_cost(at, unit) + child_cost(at + 2u, unit);
    }
    sums[me] = sum;
    for (uint half_ = 128u; half_ > 0u; half_ /= 2u) {
        barrier();
        if (me < half_) {
            sums[me] += sums[me + half_];
        }
    }
    if (me == 0u) {
        float all_ = area(low / unit, high / unit);
        // A mesh without any extent costs nothing that a rebuild could spare.
        costs[push.run.z] = all_ > 0.0 ? 1.0 + sums[0] / all_ : 0.0;
    }
}
