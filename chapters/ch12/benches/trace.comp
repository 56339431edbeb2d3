// Rays of the bench as compute, an invocation for each.

layout(local_size_x = 64) in;

#include "benches/trace.glsl"

void main() { run(gl_GlobalInvocationID); }
