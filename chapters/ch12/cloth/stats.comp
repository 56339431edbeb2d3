// Measures each cloth with one work group: its bounds, its greatest speed, and whether all of it is finite. Minima and maxima
// do not depend on their order, so the same state gives the same bits.

layout(local_size_x = GROUP) in;

#include "cloth.glsl"

layout(BIND(0, 2, 2), std430) readonly buffer Positions_ { float positions[]; };
layout(BIND(0, 3, 3), std430) readonly buffer Velocities_ { float velocities[]; };
layout(BIND(0, 4, 4), std430) writeonly buffer Stats_ { float stats[]; };  // low, speed squared; high, 1: not finite

shared vec4 lows[GROUP];
shared vec4 highs[GROUP];

// By bits: compilers may assume that no operand of a comparison is NaN.
bool is_finite(vec4 v) {
    return all(notEqual(floatBitsToUint(v) & 0x7f800000u, uvec4(0x7f800000u)));
}

void main() {
    uint c = gl_WorkGroupID.x;
    uint mine = gl_LocalInvocationID.x;
    uvec2 own = cloths[c].particles;
    vec4 low = vec4(3.0e38, 3.0e38, 3.0e38, 0.0);
    vec4 high = vec4(-3.0e38, -3.0e38, -3.0e38, 0.0);
    for (uint i = own.x + mine; i < own.x + own.y; i += GROUP) {
        vec3 x = LOAD3(positions, i);
        vec3 v = LOAD3(velocities, i);
        float speed = dot3(v, v);
        low = vec4(min(low.xyz, x), max(low.w, speed));
        high = vec4(max(high.xyz, x), is_finite(vec4(x, speed)) ? high.w : 1.0);
    }
    lows[mine] = low;
    highs[mine] = high;
    // Reduction over the invocations with a particle: the upper half passes its values to the lower half, until one is left.
    // The count depends on the cloth, so compilers keep the loop; unrolled, it would take eight times as long to compile.
    uint left = min(own.y, GROUP);
    barrier();
    while (left > 1u) {
        uint lower = (left + 1u) / 2u;
        if (mine + lower < left) {
            vec4 other = lows[mine + lower];
            low = vec4(min(low.xyz, other.xyz), max(low.w, other.w));
            high = max(high, highs[mine + lower]);
            lows[mine] = low;
            highs[mine] = high;
        }
        barrier();
        left = lower;
    }
    if (mine == 0u) {
        for (uint k = 0u; k < 4u; ++k) {
            stats[8u * c + k] = low[k];
            stats[8u * c + 4u + k] = high[k];
        }
    }
}
