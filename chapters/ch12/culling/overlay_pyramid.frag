// A level of the depth pyramid over the picture, as grey: near is bright, as under the view "depth", and black is the sky.

#include "culling/overlay.glsl"
#include "culling/pyramid.glsl"

layout(location = 0) out vec4 out_color;

struct Level {
    uvec4 number;  // x; beyond the last level the last one is shown
};
PUSH(Level, level)

void main() {
    uvec2 picture = uvec2(view.size.xy);
    uint shown = min(level.number.x, pyramid_levels(picture));
    float depth = pyramid_texel(shown, uvec2(gl_FragCoord.xy) >> shown, picture);
    float distance = view.orthographic != 0u
        ? (view.clip_from_view[3].z - depth) / view.clip_from_view[2].z
        : view.near / depth;
    float half_bright = 0.25 * view.eye.w;
    float grey = depth > 0.0 ? half_bright / (half_bright + max(distance, 0.0)) : 0.0;
    out_color = vec4(stored(vec3(grey)), 1.0);
}
