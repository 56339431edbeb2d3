// The place of a froxel, and its sample. Slices take it at a random depth that changes from frame to frame: the temporal
// filter makes a mean of them, where a fixed depth would show steps.

#include "slices.glsl"
#include "blue_noise.glsl"
#include "half.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

#ifdef TABLES_BINDING
layout(BIND(1, TABLES_BINDING, 4), std430) readonly buffer Fog_tables_ { uint fog_tables[]; };
#endif

bool is_froxel(ivec3 froxel) { return all(lessThan(froxel, ivec3(fog.size.xyz))); }

vec2 froxel_uv(ivec3 froxel) { return (vec2(froxel.xy) + 0.5) / vec2(fog.size.xy); }

// Where in its slice a froxel takes its sample, 0 to 1.
float froxel_part(ivec3 froxel) {
#ifdef JITTER
    uint texel = uint(froxel.y & 127) << 7 | uint(froxel.x & 127);
    return animated_rank(fog_tables[texel] & 0xffffu, fog.frame.x + uint(froxel.z));
#else
    return 0.5;
#endif
}

// The point of view space at which a froxel takes its sample.
vec3 froxel_sample(ivec3 froxel) {
    float depth = slice_sample(uint(froxel.z), froxel_part(froxel), fog.size.z, fog.range.x, fog.range.y);
    return view_from_volume(froxel_uv(froxel), depth, frame.steady_clip_from_view);
}

// The largest light per metre: a dense medium sends more of it than a colour can hold.
#ifdef FOG_FULL
const float LARGEST_LIGHT = 1e30;
#else
const float LARGEST_LIGHT = 65504.0;
#endif

// What is stored: devices round to halves in different ways, and a history that is cut each time would grow darker.
vec4 stored(vec4 value) {
#ifdef FOG_FULL
    return value;
#else
    return vec4(nearest_half(value.rgb), nearest_half(value.aaa).r);
#endif
}

vec3 world_of(vec3 view) { return (frame.world_from_view * vec4(view, 1.0)).xyz; }
