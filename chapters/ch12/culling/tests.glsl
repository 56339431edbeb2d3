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

// Whether any of the texels low..high of a level is as far as `nearest`, or farther. Level 0 is the picture.
bool any_farther(uint level, uvec2 low, uvec2 high, float nearest, uvec2 picture) {
    uint start = level == 0u ? picture_offset(picture) : pyramid_offset(level, picture);
    uint width = pyramid_size(level, picture).x, columns = high.x - low.x + 1u;
    uint count = columns * (high.y - low.y + 1u);
    bool found = false;
    for (uint number = 0u; number < count && !found; ++number) {
        uvec2 at = low + uvec2(number % columns, number / columns);
        found = nearest >= pyramid[start + at.y * width + at.x];
    }
    return found;
}

// The nearest depth that something may have in pixels begin..end: its own, or that of the front of its box there.
float depth_in(uvec2 begin, uvec2 end, float nearest, mat3 front, uvec2 picture) {
    vec2 to_ndc = 2.0 / vec2(picture), edge = 1.0 / 256.0 + ROUNDINGS * vec2(picture);  // as in `pixel_rect`
    vec2 low = (vec2(begin) - edge) * to_ndc - 1.0, high = (vec2(end + 1u) + edge) * to_ndc - 1.0;
    return min(nearest, front_depth(front, low, high));
}

// Whether something in a rectangle of pixels may be visible, more exactly than by the 2x2 texels of `farthest_depth`, which
// reach up to twice as far as the rectangle. Two levels below, the rectangle has at most 5x5 texels, and each bounds the
// front of the box anew. Where one of these is not nearer, its texels three levels further down are asked, of which
// 33x33 at most fit the rectangle within a 32nd. In a street half of what the first test leaves is hidden by this one.
bool seen_in(uvec2 first, uvec2 last, float nearest, mat3 front, uvec2 picture) {
    uint level = occlusion_level(first, last), coarse = max(level, 2u) - 2u, fine = max(level, 5u) - 5u;
    uint start = coarse == 0u ? picture_offset(picture) : pyramid_offset(coarse, picture);
    uint width = pyramid_size(coarse, picture).x;
    uvec2 low = first >> coarse, high = last >> coarse;
    uint columns = high.x - low.x + 1u, count = columns * (high.y - low.y + 1u);
    bool seen = false;
    for (uint number = 0u; number < count && !seen; ++number) {
        uvec2 at = low + uvec2(number % columns, number / columns);
        uvec2 begin = max(first, at << coarse), end = min(last, (at << coarse) + ((1u << coarse) - 1u));
        float depth = depth_in(begin, end, nearest, front, picture);
        if (depth >= pyramid[start + at.y * width + at.x]) {
            seen = coarse == fine || any_farther(fine, begin >> fine, end >> fine, depth, picture);
        }
    }
    return seen;
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
    mat3 front = mat3(NO_PLANE, NO_PLANE, NO_PLANE);
    if (box.known) {
        front = front_planes(bounds.centre, bounds.x, bounds.y, bounds.z, bounds.rounding);
    }
    return !seen_in(first, last, both.nearest, front, picture);
}
