// Study fragment-order, fragments of the first draw: draw a number, and enter yourself under it.

#define ACCESS writeonly
#include "order.glsl"

layout(BIND(0, 1, 1), std430) buffer Count_ {
    uint count;
};

layout(location = 0) out vec4 out_color;

void main() {
    // GPUs shade squares of 2x2 pixels. Of a square that sticks out, those outside only help with derivatives: what they
    // write to memory is dropped, and atomics with it, so that no number is lost to them.
    uint index = atomicAdd(count, 1u);
    if (index < push.numbers.z) {
        uvec2 pixel = uvec2(gl_FragCoord.xy);
        nodes[index] = pixel.y << 16 | pixel.x;
    }
    out_color = vec4(0.05, 0.05, 0.06, 1.0);
}
