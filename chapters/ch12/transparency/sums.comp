// The sum of the layers of all pixels before each, in three steps. STEP 0: the sum of each block. STEP 1: the sum of all
// blocks before each, with one work group, which decides whether the layers of the frame fit. STEP 2: the sums of pixels.

#define POOL_SET 0
#include "transparency/pool.glsl"
#include "transparency/blocks.glsl"
#include "culling/sums.glsl"

layout(BIND(0, 1, 10), std430) buffer Block_sums_ { uint block_sums[]; };
layout(BIND(0, 2, 11), std430) writeonly buffer Layers_told_ { uint told[]; };

void main() {
    uint me = gl_LocalInvocationIndex;
#if STEP == 1
    uint run = (of.picture.w + 255u) / 256u, end_of_all = of.picture.w, begin = me * run;
#else
    uint run = RUN, end_of_all = of.picture.x, begin = block() * BLOCK + me * run;
#endif
    begin = min(begin, end_of_all);
    uint end = min(begin + run, end_of_all), own = 0u;
    for (uint number = begin; number < end; ++number) {
#if STEP == 1
        own += block_sums[number];
#else
        own += pool.words[number];
#endif
    }
    uvec2 total;
    uint before = sum_before(uvec2(own, 0u), total).x;
#if STEP == 0
    if (me == 0u && block() < of.picture.w) {
        block_sums[block()] = total.x;
    }
#elif STEP == 1
    for (uint number = begin; number < end; ++number) {
        uint sum = block_sums[number];
        block_sums[number] = before;
        before += sum;
    }
    if (me == 0u) {
        uint overflow = total.x > pool.capacity ? 1u : 0u;
        pool.layers = total.x;
        pool.overflow = overflow;
        told[0] = total.x;
        told[1] = pool.capacity;
        told[2] = overflow;
    }
#else
    before += block() < of.picture.w ? block_sums[block()] : 0u;
    for (uint number = begin; number < end; ++number) {
        uint count = pool.words[number];
        pool.words[number] = before;
        before += count;
    }
#endif
}
