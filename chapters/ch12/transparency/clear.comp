// Sets the number of layers of each pixel to 0, before they are counted.

#define POOL_SET 0
#include "transparency/pool.glsl"
#include "transparency/blocks.glsl"

void main() {
    uint first = block() * BLOCK + gl_LocalInvocationIndex;
    for (uint number = first; number < min(block() * BLOCK + BLOCK, of.picture.x); number += 256u) {
        pool.words[number] = 0u;
    }
    if (first == 0u) {
        pool.layers = 0u;
        pool.capacity = of.picture.z;
        pool.width = of.picture.y;
        pool.overflow = 0u;
    }
}
