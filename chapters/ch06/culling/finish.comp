// Copies the counters of the frame to where the CPU reads them, and sets them to 0 for the next frame.

#include "culling/lists.glsl"

void main() {
    uint me = gl_LocalInvocationIndex;
    if (me < PHASES * COUNTER_WORDS) {
        told[me] = state[me];
        state[me] = 0u;
    }
}
