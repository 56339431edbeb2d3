// Sets the counters to 0 at the beginning of a frame; with TELL, copies them at its end to where the CPU reads them.

#include "culling/lists.glsl"

void main() {
    uint me = gl_LocalInvocationIndex;
    if (me < PHASES * COUNTER_WORDS) {
#ifdef TELL
        told[me] = state[me];
#else
        state[me] = 0u;
#endif
    }
}
