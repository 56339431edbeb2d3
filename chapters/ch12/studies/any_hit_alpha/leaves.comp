// Study any-hit-alpha as compute over our own hierarchy, an invocation for each pixel.

layout(local_size_x = 8, local_size_y = 8) in;

#include "leaves.glsl"

void main() { run(gl_GlobalInvocationID); }
