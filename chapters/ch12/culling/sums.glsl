// Prefix sums within a work group of 256 invocations. Subgroup operations would be faster, and OpenGL has none; their size
// is another one on every device. This scan (Hillis and Steele 1986) takes eight steps in shared memory.

shared uvec2 sums[256];

// The sum of `value` over the invocations before this one. All invocations have to call it; `total` is that of all.
uvec2 sum_before(uvec2 value, out uvec2 total) {
    uint me = gl_LocalInvocationIndex;
    sums[me] = value;
    barrier();
    for (uint step = 1u; step < 256u; step *= 2u) {
        uvec2 other = me >= step ? sums[me - step] : uvec2(0u);
        barrier();
        sums[me] += other;
        barrier();
    }
    total = sums[255];
    uvec2 before = sums[me] - value;
    barrier();  // the next call may write again
    return before;
}
