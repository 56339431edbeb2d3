// Writes the records of the instances (VkAccelerationStructureInstanceKHR, 64 bytes) from which the upper level is built,
// in the order of the table: the place of each instance is read where draws read it, so nothing comes from the CPU.

layout(local_size_x = 64) in;

struct Push { uvec4 count; };  // x: records
PUSH(Push, push)

struct Instance {
#include "instance.glsl"
};
layout(BIND(0, 0, 0), std430) readonly buffer Instances_ { Instance instances[]; };

// For each record: the address of the mesh's structure in two words, the instance, and in bits 0 to 7 its mask, above it
// its flags (rays/model.py).
layout(BIND(0, 1, 0), std430) readonly buffer Table_ { uvec4 table[]; };

struct Record {
    vec4 rows[3];     // world_from_object
    uint index_mask;  // the instance in 24 bits, then its mask
    uint flags;       // offset in the binding table in 24 bits, then flags
    uvec2 structure;
};
layout(BIND(0, 2, 0), std430) writeonly buffer Records_ { Record records[]; };
#ifdef INSTANCES_PER_PAGE
layout(BIND(0, 3, 0), std430) readonly buffer More_instances_ { Instance more_instances[]; };
#endif
#include "scene/instance_of.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.count.x) {
        return;
    }
    uvec4 entry = table[i];
    mat3x4 world_from_object = instance_of(entry.z).world_from_object;
    vec4 sizes = abs(world_from_object[0]) + abs(world_from_object[1]) + abs(world_from_object[2]);
    if (any(isnan(sizes)) || any(greaterThan(sizes, vec4(1e18)))) {
        // The box of such an instance would spoil those of others: it stands at the origin, and no ray asks for it.
        world_from_object = mat3x4(1.0);
        entry.w &= ~255u;
    }
    records[i].rows[0] = world_from_object[0];
    records[i].rows[1] = world_from_object[1];
    records[i].rows[2] = world_from_object[2];
    records[i].index_mask = entry.z | (entry.w & 255u) << 24;
    records[i].flags = entry.w >> 8 << 24;
    records[i].structure = entry.xy;
}
