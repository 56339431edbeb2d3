// A colour seen through the fog between it and the eye: fog_over(color, position, pixel), and fog_behind(color, uv) for
// what is infinitely far. Without fog both return the colour.
//
// The fog at a depth is that where its slice begins, and the part of the slice before it in closed form: exact for a medium
// that is constant in each slice. A linear step between the ends of slices would not be.

#ifdef FOG
#include "slices.glsl"
#include "medium.glsl"
#include "blue_noise.glsl"
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

// Fog is smooth, so the steps of 8 bits show in it as bands. Blue noise of at most a step each way, with a triangular
// density, makes the mean over neighbours right at any brightness. It is the same in each frame.
vec3 dithered(vec3 color, ivec2 pixel) {
    uint texel = uint(pixel.y & 127) << 7 | uint(pixel.x & 127);
    uint ranks = fog_store[texel >> 2][texel & 3u];
    float noise = triangular(vec2(animated_rank(ranks & 0xffffu, 0u), animated_rank(ranks >> 16, 0u)));
    // The slope of light over the code of sRGB, at this light.
    vec3 light = clamp(color, 0.0, 1.0);
    vec3 slope = mix(vec3(1.0 / 12.92), 2.2749 * pow(light, vec3(1.4 / 2.4)), greaterThan(light, vec3(0.0031308)));
    return max(color + noise * fog.history.y * slope, 0.0);
}

vec3 fog_over(vec3 color, vec3 position, ivec2 pixel) {
    return fog.frame.z == 0u ? color : dithered(behind_fog(color, fog_before(position)), pixel);
}

vec3 fog_behind(vec3 color, vec2 uv) {
    if (fog.frame.z == 0u) {
        return color;
    }
    return dithered(behind_fog(color, fog_to(uv, fog.range.z)), ivec2(uv * frame.size.xy));
}

// At half resolution a pixel takes the mean of the nearest pixels whose fog is known, as far as they show the same depth.
// Where none does, it looks the fog up by itself: no fog of one surface on another.
vec3 fog_over_half(vec3 color, vec3 position, ivec2 pixel) {
    if (fog.places.w == 0u || fog.frame.z == 0u) {
        return fog_over(color, position, pixel);
    }
    float depth = min(-(frame.view_from_world * vec4(position, 1.0)).z, fog.range.z);
    ivec2 last = (ivec2(frame.size.xy) + 1) / 2 - 1;
    vec4 sum = vec4(0.0);
    float count = 0.0;
    for (int i = 0; i < 4; ++i) {
        ivec2 near = min((pixel + ivec2(i & 1, i >> 1)) >> 1, last);
        uvec4 words = fog_store[fog.places.z + uint(near.y) * fog.places.w + uint(near.x)];
        if (abs(uintBitsToFloat(words.z) - depth) <= fog.bounds.w * depth) {
            sum += of_halves(words.xy);
            count += 1.0;
        }
    }
    vec4 between = count == 4.0 ? sum / 4.0 : fog_before(position);
    return dithered(behind_fog(color, between), pixel);
}
#else
vec3 fog_over(vec3 color, vec3 position, ivec2 pixel) { return color; }

vec3 fog_over_half(vec3 color, vec3 position, ivec2 pixel) { return color; }

vec3 fog_behind(vec3 color, vec2 uv) { return color; }
#endif
