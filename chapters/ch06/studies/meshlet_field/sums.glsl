// Prefix sums within a work group of any size, in shared memory. The including shader has declared its local size.

shared uvec2 partial[gl_WorkGroupSize.x];

// The sum of `value` over the invocations before this one, all of which have to call it; `total` is that of all. After
// each step, an element is the sum of twice as many (Hillis and Steele 1986).
uvec2 sum_before(uvec2 value, out uvec2 total) {
    uint me = gl_LocalInvocationIndex, size = gl_WorkGroupSize.x;
    partial[me] = value;
    barrier();
    for (uint reach = 1u; reach < size; reach *= 2u) {
        uvec2 other = me >= reach ? partial[me - reach] : uvec2(0u);
        barrier();
        partial[me] += other;
        barrier();
    }
    total = partial[size - 1u];
    uvec2 before = partial[me] - value;
    barrier();  // the next call writes again
    return before;
}
