// Study edited-draws: moves the commands inside the circle to the beginning of their part, in order, and counts them.
//
// One work group does a part. The others fill the part from its end: the list stays a permutation of all commands, and
// a count that is too large draws no command twice.

#include "edit.glsl"

layout(local_size_x = 256) in;

layout(BIND(0, 3, 3), std430) writeonly buffer Counts_ {
    uint counts[];  // draws of each part
};

const uint SIZE = gl_WorkGroupSize.x;
shared uint ranks[SIZE];

void main() {
    uint part = gl_WorkGroupID.x, local = gl_LocalInvocationID.x, seen = 0u;
    uint first = part == 0u ? push.parts.x : push.parts.z, count = part == 0u ? push.parts.y : push.parts.w;
    for (uint chunk = 0u; chunk < count; chunk += SIZE) {
        uint i = chunk + local;
        bool kept = i < count && is_inside(all[first + i]);
        ranks[local] = uint(kept);
        barrier();
        // An inclusive prefix sum (Hillis and Steele 1986): after each step, sums over twice as many invocations.
        for (uint reach = 1u; reach < SIZE; reach *= 2u) {
            uint before = local >= reach ? ranks[local - reach] : 0u;
            barrier();
            ranks[local] += before;
            barrier();
        }
        if (i < count) {
            uint rank = seen + ranks[local] - uint(kept);  // commands before this one that are kept
            uint place = kept ? rank : count - 1u - (i - rank);
            edited[first + place] = all[first + i];
        }
        seen += ranks[SIZE - 1u];
        barrier();
    }
    if (local == 0u) {
        counts[part] = push.asked.x == AS_VISIBLE ? seen : push.asked.x;
    }
}
