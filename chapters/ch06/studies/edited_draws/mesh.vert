// Study edited-draws, vertices: everything about the draw comes from its first instance.

#include "transform.glsl"

#if BACKEND_GL
#define DRAW_ID gl_DrawIDARB
#else
#define DRAW_ID gl_DrawID
#endif

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    mat4 view_from_world;
    mat4 clip_from_view;
} frame;
layout(BIND(0, 1, 0), std430) readonly buffer Objects_ {
    mat3x4 objects[];  // the rows of world_from_object
};
layout(BIND(0, 2, 1), std430) readonly buffer Materials_ {
    vec4 materials[];
};
#if PULLED
layout(BIND(0, 3, 2), std430) readonly buffer Vertices_ {
    float numbers[];  // three floats for each position, then three for each normal
};
#else
layout(location = 0) in vec3 in_position;
layout(location = 1) in vec3 in_normal;
#endif

layout(location = 0) out vec3 out_normal;
layout(location = 1) flat out vec3 out_color;
layout(location = 2) flat out uint out_number;
invariant gl_Position;

void main() {
#if PULLED
    // The number of the vertex has the command's vertex offset in it, on both APIs.
    uint p = 3u * uint(VERTEX_ID), n = p + uint(numbers.length()) / 2u;
    vec3 position = vec3(numbers[p], numbers[p + 1u], numbers[p + 2u]);
    vec3 normal = vec3(numbers[n], numbers[n + 1u], numbers[n + 2u]);
#else
    vec3 position = in_position, normal = in_normal;
#endif
    uint record = uint(INSTANCE_ID), material = record & 0xffffu, object = record >> 16;
    vec3 world = transform_point(objects[object], position);
    gl_Position = clip_position(frame.clip_from_view, frame.view_from_world, world);
    out_normal = transform_vector(objects[object], normal);  // rotation and uniform scale: it stays perpendicular
    out_color = materials[material < uint(materials.length()) ? material : 0u].rgb;
#if SHOW == 2
    out_number = uint(DRAW_ID);
#else
    out_number = object;
#endif
}
