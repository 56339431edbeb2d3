// Study dispatch-size: push constants of the kernel and the draw, and the counters.

struct Push {
    uvec4 counted;   // columns and rows to cover, invocations of a group along x and y
    uvec4 launched;  // columns and rows of invocations, size of the picture that is drawn
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) ACCESS buffer Counters_ {
    uint counters[];  // row after row, and some after the last one
};
