// First step of depth of field: the picture at half its size, and how far each of its pixels spreads.
//
// Of the four pixels that become one, that with the widest circle decides, and others count as far as theirs is as wide:
// the colour of something sharp must not get into a pixel that will be spread.

#include "lens.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D color_hdr;
layout(BIND(1, 1, 4)) uniform sampler2D depth;

layout(location = 0) out vec4 out_half;   // rgb: light, a: signed radius in pixels of the full picture
layout(location = 1) out float out_part;  // the part of this pixel that what has the radius covers

void main() {
    ivec2 last = textureSize(depth, 0) - 1;
    ivec2 first = 2 * ivec2(gl_FragCoord.xy);
    float middle = texelFetch(depth, (last + 1) / 2, 0).r;
    vec3 colors[4];
    float radii[4];
    float widest = 0.0;
    for (int i = 0; i < 4; ++i) {
        ivec2 pixel = min(first + ivec2(i & 1, i >> 1), last);
        colors[i] = texelFetch(color_hdr, pixel, 0).rgb;
        radii[i] = radius_of(texelFetch(depth, pixel, 0).r, middle, float(last.y + 1));
        widest = abs(radii[i]) > abs(widest) ? radii[i] : widest;
    }
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        sum += max(1.0 - abs(radii[i] - widest), 0.0) * vec4(colors[i], 1.0);
    }
    out_half = vec4(sum.rgb / sum.a, widest);
    out_part = 0.25 * sum.a;
}
