// Study blue-noise: images and spectra, one texel of them for each pixel; from 10^-5 (dark) to 10 (bright) of power.

#include "srgb.glsl"

layout(BIND(0, 1, 1), std430) readonly buffer Images_ { float images[]; };
layout(BIND(0, 4, 4), std430) readonly buffer Powers_ { float powers[]; };

struct Push {
    uvec4 numbers;  // x: width and y: height of the picture, z: frames, w: steps
};
PUSH(Push, push)

layout(location = 0) out vec4 out_color;

void main() {
    // Whole numbers: a texel is never on the edge of two.
    uvec2 pixel = uvec2(gl_FragCoord.xy), cells = uvec2(2 * WAYS, KINDS);
    uvec2 fine = (2u * pixel + 1u) * cells * uint(SIZE) / (2u * push.numbers.xy);
    uvec2 cell = fine / uint(SIZE), texel = fine % uint(SIZE);
    uint way = cell.x / 2u, kind = cell.y;
    vec3 color;
    if ((cell.x & 1u) == 0u) {
        float value = images[((way * IMAGES + NOISES + kind) * SIZE + texel.y) * SIZE + texel.x];
        value /= ((kind & 1u) == 0u ? 1.0 : float(push.numbers.z)) * (kind < 2u ? 1.0 : float(push.numbers.w));
        color = srgb_from_linear(vec3(clamp(value, 0.0, 1.0)));
    } else {
        uvec2 bin = (texel + uint(SIZE) / 2u) % uint(SIZE);
        float power = powers[((way * KINDS + kind) * SIZE + bin.y) * SIZE + bin.x];
        float shown = clamp((log2(max(power, 1e-30)) / log2(10.0) + 5.0) / 6.0, 0.0, 1.0);
        color = vec3(shown * shown, shown, 0.3 + 0.7 * shown) * shown;
    }
    out_color = vec4(color, 1.0);
}
