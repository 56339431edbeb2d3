// Composites the layers of each pixel over what was lit before: sorted, if there are LISTS and they fit, else weighted.

layout(local_size_x = 8, local_size_y = 8) in;

#include "finite.glsl"
#include "transparency/weights.glsl"
#ifdef LISTS
#define POOL_SET 0
#define KEYS
#include "transparency/pool.glsl"
#include "transparency/sort.glsl"
#endif

layout(BIND(0, 3, 0), FORMAT) uniform image2D color_hdr;
layout(BIND(0, 4, 1), rgba32f) uniform readonly image2D layer_sum;
layout(BIND(0, 5, 2), r32f) uniform readonly image2D layer_weight_sum;

#if defined(LISTS) && defined(MEASURED)
// What the layers [begin, end) let through, in the order in which they came: sums of whole numbers do not depend on it.
float let_through(uint begin, uint end) {
    uint steps = 0u;  // 4096 to a stop
    for (uint place = begin; place < end; ++place) {
        float through = clamp(1.0 - colors[keys[place].w].a, exp2(-24.0), 1.0);
        steps = min(steps + uint(0.5 - 4096.0 * log2(through)), 1u << 20);
    }
    return exp2(-float(steps) / 4096.0);
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(color_hdr)))) {
        return;
    }
#ifdef LISTS
    if (pool.overflow == 0u) {
        uint number = pixel_number(uvec2(pixel)), begin = number > 0u ? pool.words[number - 1u] : 0u;
        uint end = min(pool.words[number], pool.capacity);
        if (begin < end) {
            vec4 under = imageLoad(color_hdr, pixel);
#ifdef MEASURED
            under.a *= let_through(begin, end);  // before the keys are a heap
#endif
            imageStore(color_hdr, pixel, vec4(finite_color(composited(begin, end, under.rgb)), under.a));
        }
        return;
    }
#endif
    vec4 sum = imageLoad(layer_sum, pixel);
    if (sum.a < 1.0) {
        float weights = imageLoad(layer_weight_sum, pixel).r;
        vec4 under = imageLoad(color_hdr, pixel);
        imageStore(color_hdr, pixel, vec4(finite_color(weighted_color(sum, weights, under.rgb)), under.a * sum.a));
    }
}
