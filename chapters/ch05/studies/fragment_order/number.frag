// Study fragment-order, fragments of the first draw: each takes a number, and enters its pixel there in the list.

#define ACCESS writeonly
#include "order.glsl"

layout(BIND(0, 1, 1), std430) buffer Count_ {
    uint count;
};

layout(location = 0) out vec4 out_color;

void main() {
    // GPUs shade squares of 2x2 pixels. Invocations outside of the triangle only help with derivatives: their stores and
    // atomics are dropped, so they take no numbers.
    uint index = atomicAdd(count, 1u);
    if (index < push.numbers.z) {
        uvec2 pixel = uvec2(gl_FragCoord.xy);
        nodes[index] = pixel.y << 16 | pixel.x;
    }
    out_color = vec4(0.05, 0.05, 0.06, 1.0);
}
