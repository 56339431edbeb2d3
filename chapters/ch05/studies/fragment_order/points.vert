// Study fragment-order, vertices of the second draw: an entry of the list as a triangle around the centre of its pixel.

#define ACCESS readonly
#include "order.glsl"
#include "palette.glsl"

layout(location = 0) out vec3 out_color;

// In pixels: the centre of this pixel is inside, and no other is near. Triangles avoid the APIs' own rules for points.
const vec2 CORNERS[3] = vec2[](vec2(-0.3, -0.3), vec2(0.6, -0.3), vec2(-0.3, 0.6));

void main() {
    uint index = uint(VERTEX_ID) / 3u, node = nodes[index];
    vec2 size = vec2(push.numbers.xy), pixel = vec2(node & 0xffffu, node >> 16) + 0.5;
    gl_Position = vec4((pixel + CORNERS[uint(VERTEX_ID) % 3u]) / size * 2.0 - 1.0, 0.0, 1.0);
    // Not from black on: black is a pixel without an entry.
    out_color = heat(0.15 + 0.85 * float(index) / (size.x * size.y));
}
