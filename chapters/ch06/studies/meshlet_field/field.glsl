// Studies of meshlets: the view, the records of the field, and the tests of a meshlet.

#include "transform.glsl"
#include "bounds.glsl"
#include "culling/records.glsl"

// What a command draws: WAY of the kernels.
#define COMMANDS 0  // one meshlet
#define RUNS 1  // meshlets of an instance that follow one another
#define INDICES 2  // all meshlets of an instance

struct Instance {
    mat3x4 world_from_object;  // its columns are the rows
    uvec4 range;  // first meshlet, number of meshlets, first unit, mesh
};

layout(BIND(0, 0, 0), std140) uniform View_ {
    mat4 view_from_world;
    mat4 clip_from_view;
    mat4 drawn_from_world;  // the view of the picture, which may be another than that of culling
    vec4 eye;  // w is 1 in an orthographic view, where xyz is the direction of view
    vec4 size;  // of the picture, in pixels
} view;
layout(BIND(0, 1, 0), std430) readonly buffer Instances_ {
    Instance instances[];
};

const uint MARK = 0x80000000u;  // of a unit: it begins a command (x of its place), or it is drawn (y)

// Whether any triangle of a meshlet may be seen: it is not outside of the view, and does not face away.
bool is_visible(Instance instance, Meshlet meshlet) {
#if CULLING
    mat3x4 world = instance.world_from_object;
    bool orthographic = view.eye.w != 0.0;
    float shift = view_rounding(view.view_from_world, object_reach(world, meshlet.sphere.xyz, meshlet.extent));
    float radius = meshlet.sphere.w * stretch_bound(world) + shift;
    vec3 centre = matrix_times(view.view_from_world, vec4(transform_point(world, meshlet.sphere.xyz), 1.0)).xyz;
    if (sphere_outside(centre, radius, view.clip_from_view, orthographic)) {
        return false;
    }
    // The rasteriser moves vertices to a grid of 1/256 pixel, which is this far at the distance of the meshlet.
    float distance = orthographic ? 1.0 : length(centre);
    float snapped = distance / (128.0 * abs(view.clip_from_view[1].y) * view.size.y);
    vec3 eye = eye_in_object(world, view.eye.xyz, orthographic);
    float margin = grazing_margin(radius, shift + snapped);
    return !cone_faces_away(meshlet.cone, meshlet.sphere.xyz, meshlet.sphere.w, eye, orthographic, margin);
#else
    return true;
#endif
}
