// Study screen-space-reflections: what a pixel shows, from the G-buffer, and whether it reflects.

#include "scene/scene.glsl"
#include "ibl.glsl"
#include "finite.glsl"
#include "shading/normal_code.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D depth;
layout(BIND(1, 1, 4)) uniform NORMAL_SAMPLER gbuffer_normal;
layout(BIND(1, 2, 5)) uniform sampler2D gbuffer_material;

// The direction in which the eye sees `ndc`, in the space of the view. Of a homogeneous point only w's sign counts: w > 0.
vec3 eye_ray(vec2 ndc) {
    vec4 in_view = frame.view_from_clip * vec4(ndc, 1.0, 1.0);
    return frame.orthographic != 0u ? vec3(0.0, 0.0, -1.0) : normalize(in_view.xyz);
}

vec2 ndc_of(ivec2 pixel) {
    return (vec2(pixel) + 0.5) * (2.0 * frame.size.zw) - 1.0;
}

// Unit length, in the world; what is unlit has none, and (0, 0, 0).
vec3 normal_at(ivec2 pixel) {
    vec3 n = found_normal(gbuffer_normal, pixel);
    return n * inversesqrt(max(dot(n, n), 1e-30));
}

// How much of its reflection a surface shows: all of it up to 3/4 of ROUGHEST, then less, and from it on none. What is unlit
// has an alpha of 0, and reflects nothing.
float mask_of(vec4 material) {
    float fade = clamp((ROUGHEST - material.g) / (0.25 * ROUGHEST), 0.0, 1.0);
    return material.a > 0.5 ? STRENGTH * fade : 0.0;
}
