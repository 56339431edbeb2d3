// Forward pass, vertices: to clip space, and whatever the fragments need on the way.

#include "scene/scene.glsl"
#include "scene/vertices.glsl"
#include "transform.glsl"

#ifdef SHADED
layout(location = 1) out vec3 out_normal;
#endif
#ifdef NORMAL_MAP
layout(location = 2) out vec4 out_tangent;
#endif
#ifdef TEXTURED
layout(location = 3) out vec2 out_uv0;
#endif
#ifdef UV1
layout(location = 4) out vec2 out_uv1;
#endif
#ifdef VERTEX_COLOR
layout(location = 5) out vec4 out_color;
#endif

layout(location = 0) out vec3 out_position;
layout(location = 6) flat out uint out_instance;
#ifdef UNIT_CODE
layout(location = 7) flat out uint out_code;  // see unit_code in culling/records.glsl
#endif
#ifdef INDEX_CODE
#include "visibility/base_vertex.glsl"
#endif
#ifdef MOTION
#include "motion/vertex.glsl"
layout(location = 8) out vec3 out_now;
layout(location = 9) out vec3 out_shift;
#endif
#ifdef TRIANGLE_ID
layout(location = 7) flat out uint out_index;
#endif
invariant gl_Position;

void main() {
    // Every draw of an indirect buffer names its instance as its first one, and draws it once.
    uint number = uint(INSTANCE_ID);
    uint vertex = uint(VERTEX_ID);
#ifdef UNIT_CODE
    out_code = vertex >> 24;
    vertex &= 0xFFFFFFu;
#endif
#ifdef INDEX_CODE  // the vertex offset of a draw says where in its mesh the draw's indices begin (visibility/model.py)
    vertex -= uint(BASE_VERTEX);
#ifdef TRIANGLE_ID
    out_index = uint(BASE_VERTEX);
#endif
#endif
    out_instance = number;
    Instance instance = instance_of(number);
#ifdef MOTION
    if (!moves(instance)) {
        gl_Position = OUTSIDE;
        return;
    }
#endif
    uvec4 streams[2] = meshes[instance.mesh].streams;
    vec3 world = transform_point(instance.world_from_object, fetch3(streams[0].x, vertex));
    out_position = world;
#ifdef SHADED
    out_normal = transform_vector(instance.normal_from_object, fetch3(streams[0].y, vertex));
#endif
#ifdef NORMAL_MAP
    vec4 tangent = fetch4(streams[0].z, vertex);
    // A mirror turns a right-handed frame into a left-handed one.
    float handedness = (instance.flags & INSTANCE_MIRRORED) != 0u ? -tangent.w : tangent.w;
    out_tangent = vec4(transform_vector(instance.world_from_object, tangent.xyz), handedness);
#endif
#ifdef TEXTURED
    out_uv0 = fetch2(streams[0].w, vertex);
#endif
#ifdef UV1
    out_uv1 = fetch2(streams[1].x, vertex);
#endif
#ifdef VERTEX_COLOR
    out_color = fetch4(streams[1].y, vertex);
#endif
#ifdef MOTION
    vec3 now = clip_now(world);
    out_now = now;
    out_shift = clip_shift(now, instance, streams[0].x, vertex);
#endif
#ifdef STEADY_VIEW  // without the jitter
    gl_Position = clip_position(frame.steady_clip_from_view, frame.view_from_world, world);
#else
    gl_Position = clip_position(frame.clip_from_view, frame.view_from_world, world);
#endif
}
