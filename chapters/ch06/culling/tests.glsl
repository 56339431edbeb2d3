// The tests of a box and its sphere: is it outside of the view, does it face away, is it hidden behind what was drawn?
//
// CULLING is the level of the tests: 0 none, 1 frustum, 2 cone, 3 occlusion. Every test that cannot tell says "visible".

#include "transform.glsl"
#include "bounds.glsl"
#include "culling/pyramid.glsl"

struct Bounds {
    vec3 centre_view;  // of the sphere, in view space
    float radius;
    float shift;  // how far a vertex may be off, in metres
    vec4 centre;  // of the box, in clip space, and its half axes
    vec4 x;
    vec4 y;
    vec4 z;
    vec4 rounding;  // how far corners may be off
};

vec4 clip_from_vector(vec3 vector) {
    return matrix_times(view.clip_from_view, matrix_times(view.view_from_world, vec4(vector, 0.0)));
}

// `reach` is that of the transform to the world; see bounds.glsl.
Bounds bounds_of(vec3 centre, float radius, vec3 x, vec3 y, vec3 z, vec3 reach) {
    vec4 centre_view = matrix_times(view.view_from_world, vec4(centre, 1.0));
    float rounding = view_rounding(view.view_from_world, reach);
    return Bounds(
        centre_view.xyz, radius + rounding, rounding, matrix_times(view.clip_from_view, centre_view), clip_from_vector(x),
        clip_from_vector(y), clip_from_vector(z), clip_rounding(view.clip_from_view, rounding)
    );
}

Bounds bounds_of_instance(Instance instance) {
    vec3 centre = instance.bounds_centre.xyz, extent = instance.bounds_extent.xyz;
    return bounds_of(
        centre, instance.bounds_centre.w, vec3(extent.x, 0.0, 0.0), vec3(0.0, extent.y, 0.0), vec3(0.0, 0.0, extent.z),
        world_reach(instance.world_from_object, centre, extent)
    );
}

Bounds bounds_of_meshlet(Instance instance, vec4 sphere, vec3 extent) {
    mat3x4 world = instance.world_from_object;
    return bounds_of(
        transform_point(world, sphere.xyz), sphere.w * stretch_bound(world),
        transform_vector(world, vec3(extent.x, 0.0, 0.0)), transform_vector(world, vec3(0.0, extent.y, 0.0)),
        transform_vector(world, vec3(0.0, 0.0, extent.z)), object_reach(world, sphere.xyz, extent)
    );
}

bool outside(Bounds bounds) {
    return sphere_outside(bounds.centre_view, bounds.radius, view.clip_from_view, view.orthographic != 0u)
        || box_outside(bounds.centre, bounds.x, bounds.y, bounds.z, bounds.rounding);
}

// Whether all triangles of a meshlet are seen from behind. The test is made in object space, where it is exact for any
// affine transform. A vertex moves by its rounding, and when it is snapped to 1/256 of a pixel.
bool faces_away(mat3x4 world_from_object, Bounds bounds, uint cone, vec4 sphere) {
    bool orthographic = view.orthographic != 0u;
    vec3 eye = orthographic ? -view.world_from_view[2].xyz : view.eye.xyz;
    float distance = orthographic ? 1.0 : length(bounds.centre_view);
    float snapped = distance / (128.0 * abs(view.clip_from_view[1].y) * view.size.y);
    return cone_faces_away(
        cone, sphere.xyz, sphere.w, eye_in_object(world_from_object, eye, orthographic), orthographic,
        grazing_margin(bounds.radius, bounds.shift + snapped)
    );
}

// Two-phase occlusion (Haar and Aaltonen 2015, "GPU-Driven Rendering Pipelines"): the pyramid is that of what the early
// phase drew. What is hidden behind it is hidden in this frame, however wrong the guess of the early phase was.
bool hidden(Bounds bounds) {
    Footprint box = box_footprint(bounds.centre, bounds.x, bounds.y, bounds.z, bounds.rounding);
    Footprint sphere =
        sphere_footprint(bounds.centre_view, bounds.radius, view.clip_from_view, view.orthographic != 0u);
    if (!box.known && !sphere.known) {
        return false;
    }
    // Each of the two contains the surface, and so does what they have in common.
    Footprint both = Footprint(max(box.low, sphere.low), min(box.high, sphere.high), min(box.nearest, sphere.nearest), true);
    uvec2 first, last, picture = uvec2(view.size.xy);
#ifdef SAMPLES
    pixel_rect(both, view.size.xy, first, last);
#else
    if (!centre_rect(both, view.size.xy, first, last)) {
        return true;
    }
#endif
    if (both.nearest < farthest_depth(first, last, picture)) {
        return true;
    }
    // 2x2 texels reach up to twice as far as the rectangle. Five levels below, 33x33 texels at most fit it within a
    // 32nd: in a street half of what the first test leaves is hidden by the second one. Most of what is visible has
    // a visible texel among the first ones. Below level 1 is the picture itself.
    uint level = max(occlusion_level(first, last), 5u) - 5u;
    uint start = level == 0u ? picture_offset(picture) : pyramid_offset(level, picture);
    uint width = pyramid_size(level, picture).x;
    uvec2 low = first >> level, high = last >> level;
    for (uint y = low.y; y <= high.y; ++y) {
        for (uint x = low.x; x <= high.x; ++x) {
            if (both.nearest >= pyramid[start + y * width + x]) {
                return false;
            }
        }
    }
    return true;
}
