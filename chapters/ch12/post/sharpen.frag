// Sharpening of linear light: the luminance of each pixel goes away from the mean of 3x3 pixels, and the hue stays.

#include "luminance.glsl"
#include "finite.glsl"
#include "sharpen.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D color_hdr;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(color_hdr, 0) - 1;
    vec4 color = texelFetch(color_hdr, pixel, 0);
    float sum = 0.0;
    for (int i = 0; i < 9; ++i) {
        ivec2 at = clamp(pixel + ivec2(i % 3, i / 3) - 1, ivec2(0), last);  // beyond the picture is more of its rim
        sum += luminance(texelFetch(color_hdr, at, 0).rgb);
    }
    out_color = vec4(finite_color(color.rgb * sharpening(luminance(color.rgb), sum / 9.0, AMOUNT)), color.a);
}
