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
    // Right of a row is the next one: a buffer does not know where rows end.
    uint number = place.y * size.x + place.x;
    if (number < uint(counters.length())) {
        atomicAdd(counters[number], 1u);
    }
}
