// Writes the record of each instance and its box in the upper level, from where draws read the same instance: nothing
// comes from the CPU. `refit.comp` then makes the boxes above.

layout(local_size_x = 64) in;

#define BVH_WRITTEN 1
#define RAYS_SET 0
#define RAYS_BINDING 0
#include "masks.glsl"
#include "rays/bvh/records.glsl"

struct Instance {
#include "instance.glsl"
};
layout(BIND(0, 3, 3), std430) readonly buffer Instances_ { Instance instances[]; };
layout(BIND(0, 4, 4), std430) readonly buffer Slots_ { uvec4 slots[]; };  // bvh/model.py, SLOT
#ifdef INSTANCES_PER_PAGE
layout(BIND(0, 5, 5), std430) readonly buffer More_instances_ { Instance more_instances[]; };
#endif
#include "scene/instance_of.glsl"

void main() {
    uint record = gl_GlobalInvocationID.x;
    if (record >= bvh_head.y) {
        return;
    }
    uvec4 slot = slots[record];
    Instance instance = instance_of(slot.x);
    mat3x4 matrix = instance.world_from_object;
    mat3 rows = mat3(matrix[0].xyz, matrix[1].xyz, matrix[2].xyz);
    mat3 normals = mat3(
        instance.normal_from_object[0].xyz, instance.normal_from_object[1].xyz, instance.normal_from_object[2].xyz);
    vec3 translation = vec3(matrix[0].w, matrix[1].w, matrix[2].w);
    // The matrix of normals is that of cofactors (common/numerics/transforms.py): the inverse is its transpose over a number
    // that is the same for each row of the product of both. The cofactors were made in float64.
    float scale = dot(rows[0], normals[0]);
    mat3 inverse = transpose(normals);
    for (int i = 0; i < 3; ++i) {
        inverse[i] /= scale;
    }
    uint root = bvh_instances[record].what.x;
    vec3 low = min(bvh_nodes[4u * root].xyz, bvh_nodes[4u * root + 2u].xyz);
    vec3 high = max(bvh_nodes[4u * root + 1u].xyz, bvh_nodes[4u * root + 3u].xyz);
    vec3 centre = 0.5 * low + 0.5 * high, extent = 0.5 * high - 0.5 * low;
    mat3 sizes = mat3(abs(rows[0]), abs(rows[1]), abs(rows[2]));
    vec3 place = centre * rows + translation;
    // Of the centre: three products, three sums; of the extent as many; and what the centre's own rounding takes off it.
    vec3 margin = (abs(centre) * sizes + extent * sizes + abs(translation)) * (8.0 / 16777216.0);
    vec3 reach = extent * sizes + margin;
    // Comparisons with NaN are false, and so nothing that is not finite is seen.
    bool sound = all(lessThan(abs(inverse[0]) + abs(inverse[1]) + abs(inverse[2]), vec3(1e30)))
              && all(lessThan(abs(place) + reach, vec3(1e18)));
    bool seen = sound && (instance.flags & INSTANCE_VISIBLE) != 0u && slot.z != 0u;
    for (int i = 0; i < 3; ++i) {
        bvh_instances[record].rows[i] = sound ? vec4(inverse[i], translation[i]) : vec4(0.0);
    }
    bvh_instances[record].what.y = seen ? slot.z : 0u;
    bvh_instances[record].what.w = slot.w;  // other than before, once a material became another kind
    vec3 inside_out = uintBitsToFloat(uvec3(0x7F800000u));
    bvh_nodes[2u * slot.y].xyz = seen ? place - reach : inside_out;
    bvh_nodes[2u * slot.y + 1u].xyz = seen ? place + reach : -inside_out;
}
