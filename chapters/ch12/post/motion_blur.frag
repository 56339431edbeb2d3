// Motion blur by the motion vectors of the frame: the mean of the picture along the way of each pixel.
//
// Source: McGuire, Hennessy, Bukowski and Osman 2012, "A Reconstruction Filter for Plausible Motion Blur": a sample counts
// if its own way reaches the pixel, so that nothing that stands still is drawn out over what moves behind it. The neighbourhood's longest way of that paper is left out.

#include "motion_blur.glsl"
#include "dither.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D color_hdr;
layout(BIND(0, 1, 1)) uniform sampler2D motion;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), size = textureSize(color_hdr, 0);
    vec4 own = texelFetch(color_hdr, pixel, 0);
    vec2 way = smear_of(texelFetch(motion, pixel, 0).rg, vec2(size), SHUTTER, LONGEST);
    float length_px = length(way);
    if (!(length_px > 0.5)) {  // nothing to see; and what does not move stays as it is, to the bit
        out_color = own;
        return;
    }
    // A sample for each pixel of the way, the pixel itself in the middle. Or fewer: those are then at other places for
    // neighbouring pixels, which gives fine noise in place of several sharp copies.
    int half_way = int(ceil(0.5 * length_px)), taps = 2 * half_way + 1;
    float first = -float(half_way), spacing = 1.0;
    if (taps > TAPS) {
        taps = TAPS;
        spacing = length_px / float(TAPS);
        first = interleaved_gradient(uvec2(pixel), 0u) * spacing - 0.5 * length_px;
    }
    vec4 sum = vec4(own.rgb, 1.0) / 65536.0;  // so that there is a sum, also where nothing reaches
    for (int i = 0; i < taps; ++i) {
        float distance = first + float(i) * spacing;
        ivec2 at = ivec2(floor(vec2(pixel) + 0.5 + way * (distance / length_px)));
        if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, size))) {
            continue;
        }
        vec2 other = smear_of(texelFetch(motion, at, 0).rg, vec2(size), SHUTTER, LONGEST);
        sum += smear_reaches(min(length_px, length(other)), abs(distance)) * vec4(texelFetch(color_hdr, at, 0).rgb, 1.0);
    }
    out_color = vec4(sum.rgb / sum.a, own.a);
}
