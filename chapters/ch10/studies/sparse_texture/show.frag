// Study sparse-texture: the whole texture, and a grey grid where the code says that there is no memory.

#include "fetch.glsl"

struct Push {
    vec4 size;  // of the picture, in pixels
};
PUSH(Push, push)

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), size = ivec2(push.size.xy);
    ivec2 at = (2 * pixel + 1) * (TILE * ACROSS) / (2 * size);
    uint value;
    if (fetch(at, value)) {
        out_color = vec4(vec3(uvec3(value, value >> 8, value >> 16) & 0xffu) / 255.0, 1.0);
    } else {
        bool line = any(lessThan(at % 32, ivec2(4)));
        out_color = vec4(vec3(line ? 64.0 : 46.0) / 255.0, 1.0);
    }
}
