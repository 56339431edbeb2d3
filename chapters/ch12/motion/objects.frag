// The motion of an object that moves or deforms: the division by w, for each fragment.

#include "scene/scene.glsl"
#include "shading/material.glsl"
#include "motion/reprojection.glsl"

#ifdef TEXTURED
layout(location = 3) in vec2 in_uv0;
#else
const vec2 in_uv0 = vec2(0.0);
#endif
#ifdef UV1
layout(location = 4) in vec2 in_uv1;
#else
const vec2 in_uv1 = vec2(0.0);
#endif
#ifdef VERTEX_COLOR
layout(location = 5) in vec4 in_color;
#endif
layout(location = 6) flat in uint in_instance;
layout(location = 8) in vec3 in_now;
layout(location = 9) in vec3 in_shift;

layout(location = 0) out vec2 out_motion;

void main() {
#ifdef ALPHA_MASK
    Material material = materials[instance_of(in_instance).material];
    float alpha = material.base_color.a;
#ifdef VERTEX_COLOR
    alpha *= in_color.a;
#endif
#ifdef BASE_COLOR_MAP
    alpha *= sample_map(base_color_map, image_uv(material, 0, in_uv0, in_uv1)).a;
#endif
    if (alpha < material.emissive.a) {
        discard;
    }
#endif
    precise vec3 before = in_now + in_shift;
    out_motion = motion_between(in_now, before);
}
