// Study far-march: what is seen, behind its fog.

#include "air.glsl"
#include "plain.glsl"
#include "srgb.glsl"

layout(BIND(0, 2, 2), std430) readonly buffer Fog_ { vec4 fog[]; };

layout(location = 0) out vec4 out_color;

void main() {
    uvec2 pixel = uvec2(gl_FragCoord.xy);
    Seen seen = seen_along(ray_through((vec2(pixel) + 0.5) / air.target.xy));
    vec3 color = behind_fog(seen.color, fog[pixel.y * uint(air.target.x) + pixel.x]);
    out_color = vec4(srgb_from_linear(clamp(color, 0.0, 1.0)), 1.0);
}
