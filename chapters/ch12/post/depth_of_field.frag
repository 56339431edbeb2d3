// Last step of depth of field: the sharp picture, the blurred one where it is out of focus, and over both what lies before
// the focus.

#include "lens.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D color_hdr;
layout(BIND(1, 1, 4)) uniform sampler2D depth;
layout(BIND(1, 2, 5)) uniform sampler2D dof_blurred;
layout(BIND(1, 3, 6)) uniform sampler2D dof_near;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 sharp = texelFetch(color_hdr, pixel, 0);
    float middle = texelFetch(depth, textureSize(depth, 0) / 2, 0).r;
    float radius = radius_of(texelFetch(depth, pixel, 0).r, middle, float(textureSize(depth, 0).y));

    // The four pixels of the half-size picture around this one. Behind the focus those count that are blurred as much:
    // the others are another surface's. The last summand keeps some weight where none is.
    ivec2 last = textureSize(dof_blurred, 0) - 1;
    vec2 place = 0.5 * (vec2(pixel) + 0.5) - 0.5;
    vec2 part = fract(place);
    vec4 far = vec4(0.0);
    vec4 near = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        ivec2 corner = ivec2(i & 1, i >> 1);
        ivec2 at = clamp(ivec2(floor(place)) + corner, ivec2(0), last);
        vec2 weights = mix(1.0 - part, part, vec2(corner));
        float weight = weights.x * weights.y;
        vec4 behind = texelFetch(dof_blurred, at, 0);
        vec4 before = texelFetch(dof_near, at, 0);
        far += weight * (max(1.0 - abs(behind.a - radius), 0.0) + 1e-4) * vec4(behind.rgb, 1.0);
        near += weight * before.a * vec4(before.rgb, 1.0);
    }
    vec3 color = mix(sharp.rgb, far.rgb / far.a, blurred_part(radius));
    if (near.a > 0.0) {
        color = mix(color, near.rgb / near.a, near.a);
    }
    out_color = vec4(color, sharp.a);
}
