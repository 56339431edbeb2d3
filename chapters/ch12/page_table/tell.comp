// Hands the report of a frame over to the CPU, and empties it for the next one.

layout(constant_id = 0) const uint SUBGROUP_SIZE = 64u;  // from the device: words are copied one by one
layout(local_size_x = 64, local_size_x_id = 0) in;

#define NEEDS_BINDING 0
layout(BIND(1, 0, 4), std430) buffer Needs_ { uint needs[]; };
layout(BIND(1, 1, 5), std430) writeonly buffer Told_ { uint told[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < needs.length()) {
        told[i] = needs[i];
        needs[i] = 0u;
    }
}
