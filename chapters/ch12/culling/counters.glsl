// Counters of a work group, added to those of the phase once for each group. Where several passes draw a phase, the first
// one alone counts.

shared uint counted[COUNTERS];

void begin_counting() {
    if (gl_LocalInvocationIndex < COUNTERS) {
        counted[gl_LocalInvocationIndex] = 0u;
    }
    barrier();
}

void count(uint counter, uint number) {
    if (number > 0u && tells()) {
        atomicAdd(counted[counter], number);
    }
}

void end_counting() {
    barrier();
    uint me = gl_LocalInvocationIndex;
    if (me < COUNTERS && counted[me] > 0u) {
        atomicAdd(state[phase() * COUNTER_WORDS + me], counted[me]);
    }
}
