// The picture of a study with rays: the colour that its rays have found for each pixel.

#include "srgb.glsl"

layout(BIND(0, 0, 0), std140) uniform Eye_ {
    mat4 view_from_clip;
    mat4 world_from_view;
    uvec4 size;
} eye;

struct Pixel {
    vec4 color;
    uvec4 what;
};
layout(BIND(0, 1, 1), std430) readonly buffer Pixels_ { Pixel pixels[]; };

layout(location = 0) out vec4 out_color;

void main() {
    uvec2 pixel = uvec2(gl_FragCoord.xy);
    vec3 color = pixels[pixel.y * eye.size.x + pixel.x].color.rgb;
    out_color = vec4(srgb_from_linear(clamp(color, 0.0, 1.0)), 1.0);
}
