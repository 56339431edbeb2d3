// A level of the bloom pyramid: 4x4 texels of the one before with weights 1, 3, 3, 1 along each axis, which is the
// product of a box and a tent. The box alone would let a small light jump from texel to texel as it moves.

#include "finite.glsl"
#include "bright.glsl"
#include "hdr/bloom.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D wide;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 first = 2 * ivec2(gl_FragCoord.xy) - 1;
    vec3 sum = vec3(0.0);
    for (int y = 0; y < 4; ++y) {
        for (int x = 0; x < 4; ++x) {
            float weight = (x == 1 || x == 2 ? 0.375 : 0.125) * (y == 1 || y == 2 ? 0.375 : 0.125);
            vec3 color = texel_at(wide, first + ivec2(x, y)).rgb;
#if LEVEL == 1
            color = bright_part(finite_color(color), THRESHOLD);
#endif
            sum += weight * color;
        }
    }
    out_color = vec4(finite_color(sum), 1.0);
}
