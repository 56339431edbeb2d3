// Study bias-explorer: a row of cells for each bias and a column for each tilt; acne is red, and what is lit below the
// sheet is yellow. Lines mark heights of 1, 2 and 3 texels, so the yellow part is a bar as high as the gap.

#include "compare.glsl"

struct Push {
    vec4 size;  // of the picture, in pixels
};
PUSH(Push, push)

layout(location = 0) out vec4 out_color;

void main() {
    // Pixels may lie on the edges of texels: an interpolated coordinate would be rounded to either side.
    precise vec2 cell = gl_FragCoord.xy * vec2(TILTS, BIASES) / push.size.xy;
    ivec2 number = min(ivec2(cell), ivec2(TILTS, BIASES) - 1);
    precise vec2 within = cell - vec2(number);
    vec2 at = vec2(within.x, 1.0 - within.y) * float(SIDE);
    float lit = lit_part(number.x, number.y, at);
    vec3 color = vec3(0.45, 0.47, 0.5) * (0.4 + 0.6 * lit);
    if (is_bare(at)) {
        color = mix(vec3(0.85, 0.18, 0.12), vec3(0.74, 0.75, 0.76), lit);
    } else if (is_below(at)) {
        color = mix(vec3(0.17, 0.19, 0.25), vec3(0.95, 0.76, 0.2), lit);
        float height = height_of(at.y), mark = round(height);
        if (mark > 0.0 && abs(height - mark) < 0.04) {
            color = mix(color, vec3(1.0), 0.25);
        }
    }
    if (any(lessThan(min(within, 1.0 - within) * vec2(1.0, 2.0), vec2(0.04)))) {
        color = vec3(0.05, 0.05, 0.06);
    }
    out_color = vec4(color, 1.0);
}
