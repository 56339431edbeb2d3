// Study compute-buffers, the kernel: one number for each invocation.

layout(local_size_x = 64) in;  // a multiple of the 32 or 64 invocations that GPUs run in step

struct Push {
    uvec4 numbers;  // a, b, count
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) readonly buffer Input_ {
    uint x[];
};
layout(BIND(0, 1, 1), std430) writeonly buffer Output_ {
    uint y[];
};

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.numbers.z) {
        return;  // only in the last group
    }
    // Integers: exact, and the same on every GPU.
    y[i] = push.numbers.x * x[i] + push.numbers.y;
}
