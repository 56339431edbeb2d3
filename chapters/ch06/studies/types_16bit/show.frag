// Study types-16bit, fragments: above, bars of x before those of y; below, how far each g is from the exact c h + d.

#define ACCESS readonly
#include "numbers.glsl"
#include "half.glsl"

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

#if WAY == 0
#define INTEGER_OF(buffer, i) int(buffer[i])
#define HALF_OF(buffer, i) float(buffer[i])
#elif WAY == 1
#define INTEGER_OF(buffer, i) bitfieldExtract(int(buffer[(i) >> 1]), 16 * int((i) & 1u), 16)
#define HALF_OF(buffer, i) half_value(buffer[(i) >> 1] >> 16u * ((i) & 1u) & 0xffffu)
#else
#define INTEGER_OF(buffer, i) int(buffer[i])
#define HALF_OF(buffer, i) half_value(buffer[i])
#endif

// Whether a bar from 0 to `value` covers a height; both may be negative.
bool covers(float value, float height) {
    return height >= 0.0 ? height < value : height > value;
}

void main() {
    uint i = min(uint(in_uv.x * float(COUNT)), uint(COUNT - 1));
    vec3 color = vec3(0.05, 0.05, 0.06);
    if (in_uv.y < 0.5) {
        float height = (1.0 - 4.0 * in_uv.y) * 32768.0;
        if (covers(float(INTEGER_OF(y, i)), height)) {
            color = vec3(0.1, 0.45, 0.55);
        }
        if (covers(float(INTEGER_OF(x, i)), height)) {
            color = vec3(0.95, 0.75, 0.3);
        }
    } else {
        // The last place of a half is 1 from 1024 on, 0.5 from 512 on: the error of rounding is at most half of it.
        precise float exact = half_value(push.halves.x) * HALF_OF(h, i) + half_value(push.halves.y);
        if (covers(HALF_OF(g, i) - exact, 0.75 * (3.0 - 4.0 * in_uv.y))) {
            color = vec3(0.85, 0.35, 0.25);
        }
    }
    out_color = vec4(color, 1.0);
}
