// A colour seen through the fog between it and the eye: fog_over(color, position) and fog_behind(color) for what is
// infinitely far. Without fog both return the colour.
//
// The fog at a depth is that where its slice begins, and the part of the slice before it in closed form: exact for a medium
// that is constant in each slice. A linear step between the ends of slices would not be.

#ifdef FOG
#include "slices.glsl"
#include "medium.glsl"
#include "fog/records.glsl"

// Light and transmittance from the eye to a depth in metres.
vec4 fog_to(vec2 uv, float depth) {
    depth = min(depth, fog.range.z);
    float count = float(fog.size.z);
    uint slice = min(uint(max(slice_coordinate(depth, fog.range.x, fog.range.y) * count, 0.0)), fog.size.z - 1u);
    vec2 place = clamp(uv * vec2(fog.size.xy) - 0.5, vec2(0.0), vec2(fog.size.xy - 1u));
    ivec2 first = ivec2(place), last = ivec2(fog.size.xy) - 1;
    vec2 part = place - vec2(first);
    vec4 before = vec4(0.0), here = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        ivec2 corner = ivec2(i & 1, i >> 1);
        vec2 weights = mix(1.0 - part, part, vec2(corner));
        vec4 corner_before, corner_here;
        read_record(ivec3(min(first + corner, last), int(slice)), corner_before, corner_here);
        before += weights.x * weights.y * corner_before;
        here += weights.x * weights.y * corner_here;
    }
    float metres = max(depth - slice_begin(slice, fog.size.z, fog.range.x, fog.range.y), 0.0);
    return through_segment(before, here.rgb, here.a, metres * ray_stretch(uv, frame.steady_clip_from_view));
}

vec4 fog_before(vec3 position) {
    if (fog.frame.z == 0u) {
        return vec4(0.0, 0.0, 0.0, 1.0);
    }
    vec3 view = (frame.view_from_world * vec4(position, 1.0)).xyz;
    vec3 place = volume_from_view(view, frame.steady_clip_from_view);
    return fog_to(place.xy, place.z);
}

vec3 fog_over(vec3 color, vec3 position) { return behind_fog(color, fog_before(position)); }

vec3 fog_behind(vec3 color, vec2 uv) {
    return fog.frame.z == 0u ? color : behind_fog(color, fog_to(uv, fog.range.z));
}
#else
vec3 fog_over(vec3 color, vec3 position) { return color; }

vec3 fog_behind(vec3 color, vec2 uv) { return color; }
#endif
