// Blends each froxel with the history at the place where its centre was in the frame before. The history is that before
// integration: light of a froxel moves with it, a sum along the ray does not.

#include "scene/scene.glsl"
#include "medium.glsl"
#include "grid.glsl"

layout(BIND(1, 0, 3)) uniform sampler3D fog_now;
layout(BIND(1, 1, 4)) uniform sampler3D history_before;
layout(BIND(1, 2, 0), FORMAT) uniform writeonly image3D history_fog;

// Between eight texels; weights of a sampler have 8 bits on many devices, and a history is fetched again and again.
vec4 history_at(vec3 uvw) {
    vec3 place = clamp(uvw * vec3(fog.size.xyz) - 0.5, vec3(0.0), vec3(fog.size.xyz - 1u));
    ivec3 first = ivec3(place), last = ivec3(fog.size.xyz) - 1;
    vec3 part = place - vec3(first);
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 8; ++i) {
        ivec3 corner = ivec3(i & 1, i >> 1 & 1, i >> 2);
        vec3 weights = mix(1.0 - part, part, vec3(corner));
        float weight = weights.x * weights.y * weights.z;
        if (weight > 0.0) {  // a value that is not finite has no part in others
            sum += weight * texelFetch(history_before, min(first + corner, last), 0);
        }
    }
    return sum;
}

// The coordinates of a froxel's centre in the frame before; outside of 0..1 it was not in the grid.
vec3 place_before(ivec3 froxel) {
    float depth = slice_depth((float(froxel.z) + 0.5) / float(fog.size.z), fog.range.x, fog.range.y);
    vec3 view = view_from_volume(froxel_uv(froxel), depth, frame.steady_clip_from_view);
    vec3 before = (frame.previous_view_from_world * vec4(world_of(view), 1.0)).xyz;
    vec3 volume = volume_from_view(before, frame.previous_steady_clip_from_view);
    return vec3(volume.xy, slice_coordinate(volume.z, fog.range.x, fog.range.y));
}

void main() {
    ivec3 froxel = ivec3(gl_GlobalInvocationID);
    if (!is_froxel(froxel)) {
        return;
    }
    vec4 current = texelFetch(fog_now, froxel, 0), blended = current;
    if ((frame.valid_histories & HISTORY_FOG) != 0u && fog.frame.w != 0u) {
        bool still = fog.frame.y != 0u;  // no place to compute, and no rounding of it
        vec3 uvw = still ? vec3(0.5) : place_before(froxel);
        if (all(greaterThanEqual(uvw, vec3(0.0))) && all(lessThanEqual(uvw, vec3(1.0)))) {
            vec4 history = still ? texelFetch(history_before, froxel, 0) : history_at(uvw);
            history.rgb *= exposure() / previous_exposure();
            blended = blended_history(history, current, fog.history.x);
        }
    }
    imageStore(history_fog, froxel, stored(blended));
}
