// The environment behind everything: each pixel looks it up in its own direction. The triangle lies at depth 0, infinitely
// far away, and is drawn after what is solid: only pixels that nothing covers are shaded.

#include "scene/scene.glsl"
#include "environment.glsl"
#include "finite.glsl"
#include "fog/apply.glsl"

#ifndef COMPUTED
layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;
#endif

void main() {
    vec2 uv = in_uv;
#ifdef BY_RATES  // from the middle of a block to that of the pixel that is lit
    uv += (floor(min(gl_FragCoord.xy, frame.size.xy - 0.5)) + 0.5 - gl_FragCoord.xy) * frame.size.zw;
#endif
#ifdef BACKGROUND
    vec3 color = vec3(BACKGROUND);
#else
    // Towards the point of the near plane that this pixel shows; an orthographic view looks everywhere the same way.
    vec4 near = frame.view_from_clip * vec4(uv * 2.0 - 1.0, 1.0, 1.0);
    vec3 in_view = frame.orthographic != 0u ? vec3(0.0, 0.0, -1.0) : near.xyz / near.w;
    vec3 d = turned_back(mat3(frame.world_from_view) * in_view, frame.environment.yz);
    vec3 color = frame.environment.x * exposure() * textureLod(environment_radiance, d, 0.0).rgb;
#endif
    out_color = vec4(finite_color(fog_behind(color, uv)), 1.0);
}
