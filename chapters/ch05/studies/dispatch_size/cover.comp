// Study dispatch-size, the kernel: each invocation adds one at its place.

layout(local_size_x = LOCAL_X, local_size_y = LOCAL_Y) in;

#define ACCESS
#include "numbers.glsl"

void main() {
    uvec2 place = gl_GlobalInvocationID.xy, size = push.counted.xy;
#if GUARD
    if (place.x >= size.x || place.y >= size.y) {
        return;
    }
#endif
    // A buffer has no rows: a place right of a row is in the next one.
    uint number = place.y * size.x + place.x;
    if (number < uint(counters.length())) {
        atomicAdd(counters[number], 1u);
    }
}
