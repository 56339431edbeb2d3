// Sorts pairs by their first word, four bits at a time from the lowest on (radix sort). It is stable and has one result: an
// invocation counts, and later places, a run of neighbours in their order, and no atomics take part.
//
// COUNTS: the pairs of each digit in each run. SCAN: where the pairs of each digit and run begin. Without either: places.

#ifdef SCAN
layout(local_size_x = 256) in;
#else
layout(local_size_x = 64) in;
#endif

struct Push {
    uvec4 run;  // x: pairs, y: the lowest bit of the digit, z: the first pair
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) readonly buffer From_ { uvec2 from[]; };
layout(BIND(0, 1, 1), std430) writeonly buffer To_ { uvec2 to[]; };
layout(BIND(0, 2, 2), std430) buffer Counts_ { uint counts[]; };  // digit by digit, run by run

const uint RUN_LENGTH = 32u, DIGITS = 16u;

uint runs() { return (push.run.x + RUN_LENGTH - 1u) / RUN_LENGTH; }

#ifdef SCAN
shared uint sums[256];

void main() {
    uint me = gl_LocalInvocationIndex, all_ = DIGITS * runs(), each = (all_ + 255u) / 256u;
    uint begin = min(me * each, all_), end = min(begin + each, all_), sum = 0u;
    for (uint at = begin; at < end; ++at) {
        sum += counts[at];
    }
    sums[me] = sum;
    barrier();
    for (uint reach = 1u; reach < 256u; reach *= 2u) {
        uint below = me >= reach ? sums[me - reach] : 0u;
        barrier();
        sums[me] += below;
        barrier();
    }
    uint before = sums[me] - sum;
    for (uint at = begin; at < end; ++at) {
        uint count = counts[at];
        counts[at] = before;
        before += count;
    }
}
#else
void main() {
    uint run = gl_GlobalInvocationID.x;
    if (run >= runs()) {
        return;
    }
    uint begin = run * RUN_LENGTH, end = min(begin + RUN_LENGTH, push.run.x);
    uint places[DIGITS];
    for (uint digit = 0u; digit < DIGITS; ++digit) {
#ifdef COUNTS
        places[digit] = 0u;
#else
        places[digit] = counts[digit * runs() + run];
#endif
    }
    for (uint at = begin; at < end; ++at) {
        uvec2 pair = from[push.run.z + at];
        uint digit = pair.x >> push.run.y & (DIGITS - 1u);
#ifndef COUNTS
        to[push.run.z + places[digit]] = pair;
#endif
        ++places[digit];
    }
#ifdef COUNTS
    for (uint digit = 0u; digit < DIGITS; ++digit) {
        counts[digit * runs() + run] = places[digit];
    }
#endif
}
#endif
