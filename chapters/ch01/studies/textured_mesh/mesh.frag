// Study textured-mesh, fragments: the picture at uv, as light, and then as the codes of a display.

#include "mesh.glsl"
#include "srgb.glsl"

layout(BIND(0, 1, 0)) uniform sampler2D base_color;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    // A pixel may cover a thousand texels. Neighbouring fragments tell the sampler how far uv moves from pixel to pixel,
    // and it reads the mip level on which that is about one texel: all of them were averaged ahead.
    //
    // Files hold codes, about the square root of light, since eyes see dark steps better than bright ones. Averages are
    // meant of light: half black and half white is code 188 from afar, not 128. The format of the image ("sRGB") makes
    // the sampler decode before it filters; a shader that writes codes itself must encode again.
    vec3 light = texture(base_color, in_uv).rgb * frame.base_color.rgb;
    out_color = vec4(srgb_from_linear(clamp(light, 0.0, 1.0)), 1.0);
}
