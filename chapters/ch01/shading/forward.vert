// Forward pass, vertices: to clip space, and whatever the fragments need on the way.

#include "scene/scene.glsl"
#include "transform.glsl"

layout(location = 0) in vec3 in_position;
#ifdef SHADED
layout(location = 1) in vec3 in_normal;
layout(location = 1) out vec3 out_normal;
#endif
#ifdef NORMAL_MAP
layout(location = 2) in vec4 in_tangent;
layout(location = 2) out vec4 out_tangent;
#endif
#ifdef TEXTURED
layout(location = 3) in vec2 in_uv0;
layout(location = 3) out vec2 out_uv0;
#endif
#ifdef UV1
layout(location = 4) in vec2 in_uv1;
layout(location = 4) out vec2 out_uv1;
#endif
#ifdef VERTEX_COLOR
layout(location = 5) in vec4 in_color;
layout(location = 5) out vec4 out_color;
#endif

layout(location = 0) out vec3 out_position;
invariant gl_Position;

void main() {
    Instance instance = instances[push.draw.x];
    vec3 world = transform_point(instance.world_from_object, in_position);
    out_position = world;
#ifdef SHADED
    out_normal = transform_vector(instance.normal_from_object, in_normal);
#endif
#ifdef NORMAL_MAP
    // A mirror turns a right-handed frame into a left-handed one.
    float handedness = (instance.flags & INSTANCE_MIRRORED) != 0u ? -in_tangent.w : in_tangent.w;
    out_tangent = vec4(transform_vector(instance.world_from_object, in_tangent.xyz), handedness);
#endif
#ifdef TEXTURED
    out_uv0 = in_uv0;
#endif
#ifdef UV1
    out_uv1 = in_uv1;
#endif
#ifdef VERTEX_COLOR
    out_color = in_color;
#endif
    gl_Position = clip_position(frame.clip_from_view, frame.view_from_world, world);
}
