// The path tracer as compute, an invocation for each pixel.

layout(local_size_x = 8, local_size_y = 8) in;

#include "paths/paths.glsl"

void main() { run(gl_GlobalInvocationID); }
