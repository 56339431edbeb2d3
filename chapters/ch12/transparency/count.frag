// Counts the layers of each pixel. The depth test comes first: what lies behind a solid surface is no layer.

layout(early_fragment_tests) in;

#define POOL_SET 3
#include "transparency/pool.glsl"

void main() {
    atomicAdd(pool.words[pixel_number(uvec2(gl_FragCoord.xy))], 1u);
}
