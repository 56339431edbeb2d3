// Temporal anti-aliasing (Karis 2014, "High-quality temporal supersampling"; Salvi 2016 for the box of a variance): the
// history is found along the motion of the pixel, brought close to what the pixel's neighbourhood shows, and blended.
//
// The alpha of the history is 1 / distance of the surface ahead of the camera, 0 for the sky. A history whose surfaces lie
// nowhere near those that should be there shows something else, and is rejected.

layout(local_size_x = 8, local_size_y = 8) in;

#include "scene/scene.glsl"
#include "luminance.glsl"
#include "taa/color.glsl"
#include "taa/filters.glsl"
#include "taa/history.glsl"
#include "taa/neighbourhood.glsl"
#include "taa/constraint.glsl"
#include "taa/weights.glsl"
#include "taa/velocity.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D color_hdr;
layout(BIND(1, 1, 4)) uniform sampler2D depth;
layout(BIND(1, 2, 5)) uniform sampler2D motion;
layout(BIND(1, 3, 6)) uniform sampler2D history_color;
#ifdef SCALED
layout(BIND(1, 4, 7)) uniform sampler2D history_weight;
layout(BIND(1, 5, 0), FORMAT) uniform writeonly image2D resolved;
layout(BIND(1, 6, 1), r32f) uniform writeonly image2D resolved_weight;
#include "taa/upscale.glsl"
#define DRAWN(pixel) drawn.pixel
#else
layout(BIND(1, 4, 0), FORMAT) uniform writeonly image2D resolved;
#define DRAWN(pixel) (pixel)
#endif

// The closest surface of 3x3 pixels is another one than that of the pixel if it is nearer by this part of the distance.
const float SILHOUETTE = 0.1;

bool is_finite_color(vec3 color) {
    return !any(isnan(color)) && !any(isinf(color));
}

#ifdef YCOCG
#define INNER(color) ycocg_from_rgb(color)
#define OUTER(color) rgb_from_ycocg(color)
#else
#define INNER(color) (color)
#define OUTER(color) (color)
#endif

// 1 / distance ahead of the camera at depth d, from the inverse of the projection; 0 where nothing was drawn.
float inverse_distance(float d) {
    if (d == 0.0) {
        return 0.0;
    }
    vec2 zw = frame.view_from_clip[2].zw * d + frame.view_from_clip[3].zw;
    return -zw.y / zw.x;
}

#ifdef TOLERANCE
// Whether the history at uv_before may show what the pixel shows: the range of distances there overlaps that of the 3x3
// pixels here. `led_by` is the pixel whose motion was taken: the camera's own motion along its view changes distances.
bool same_surface(ivec2 pixel, ivec2 led_by, vec2 uv_before, vec2 size) {
    float low = 3e38, high = 0.0;
    ivec2 last = ivec2(size) - 1;
    for (int y = -1; y <= 1; ++y) {
        for (int x = -1; x <= 1; ++x) {
            float here = inverse_distance(texelFetch(depth, clamp(pixel + ivec2(x, y), ivec2(0), last), 0).r);
            low = min(low, here);
            high = max(high, here);
        }
    }
    float here = inverse_distance(texelFetch(depth, led_by, 0).r);
    if (here > 0.0) {
        vec2 ndc = (vec2(led_by) + 0.5) * (2.0 * frame.size.zw) - 1.0;
        vec4 in_view = frame.view_from_clip * vec4(ndc, texelFetch(depth, led_by, 0).r, 1.0);
        vec4 world = frame.world_from_view * vec4(in_view.xyz / in_view.w, 1.0);
        float before = -(frame.previous_view_from_world * world).z;
        float ratio = before > 0.0 ? 1.0 / (before * here) : 1.0;
        low *= ratio;
        high *= ratio;
    }
    float least = 3e38, most = 0.0;
    ivec2 first = ivec2(floor(uv_before * vec2(imageSize(resolved)) - 0.5));
    last = imageSize(resolved) - 1;
    for (int i = 0; i < 4; ++i) {
        float found = texelFetch(history_color, clamp(first + ivec2(i & 1, i >> 1), ivec2(0), last), 0).a;
        least = min(least, found);
        most = max(most, found);
    }
    return least * (1.0 - TOLERANCE) <= high && low <= most * (1.0 + TOLERANCE);
}
#endif

vec3 blended(ivec2 pixel, vec4 current, float ratio) {
    vec2 size = frame.size.xy;
    ivec2 last = ivec2(size) - 1, at = DRAWN(pixel), led_by = at;
#ifdef CLOSEST
    led_by = closest(depth, at);
    // Inside of a surface, which may turn, the vector of the pixel itself is right.
    float here = inverse_distance(texelFetch(depth, at, 0).r);
    if (here > (1.0 - SILHOUETTE) * inverse_distance(texelFetch(depth, led_by, 0).r)) {
        led_by = at;
    }
#endif
    vec2 moved = texelFetch(motion, led_by, 0).xy;
#ifdef LONGEST
    moved = longest(motion, at);
#endif
    vec2 uv_before = (vec2(pixel) + 0.5) / vec2(imageSize(resolved)) - moved;
    bool outside = any(lessThan(uv_before, vec2(0.0))) || any(greaterThan(uv_before, vec2(1.0)));
    if (outside || any(isnan(uv_before))) {
        return current.rgb;
    }
#ifdef TOLERANCE
    if (!same_surface(at, led_by, uv_before, size)) {
        return current.rgb;
    }
#endif
    vec3 before;
    if (moved == vec2(0.0)) {
        before = texelFetch(history_color, pixel, 0).rgb;
    } else {
#ifdef CATMULL_ROM
        before = catmull_rom(history_color, uv_before);
#else
        before = bilinear(history_color, uv_before);
#endif
    }
    before *= ratio;
    if (!is_finite_color(before)) {  // one texel that is not finite would stay, and spread by the filter
        return current.rgb;
    }
    vec3 samples[9];
    for (int i = 0; i < 9; ++i) {
        ivec2 neighbour = clamp(at + ivec2(i % 3 - 1, i / 3 - 1), ivec2(0), last);
        samples[i] = INNER(texelFetch(color_hdr, neighbour, 0).rgb);
    }
    Neighbourhood around = gathered(samples, 0.5 * frame.jitter * size);
#ifdef SCALED
    around.filtered = INNER(drawn.color);
#endif
    vec3 history = constrained(INNER(before), around);
    vec2 shares = weights(around.filtered, history, around, frame.previous_eye.w);
#ifdef SCALED
    shares.x *= drawn.confidence;
#endif
#ifdef REACTIVE
    shares.y *= 1.0 - REACTIVE * clamp(1.0 - current.a, 0.0, 1.0);
#endif
    vec3 mixed = (around.filtered * shares.x + history * shares.y) / max(shares.x + shares.y, 1e-5);
    return max(OUTER(mixed), vec3(0.0));
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(resolved)))) {
        return;
    }
#ifdef SCALED
    drawn = drawn_for(pixel, imageSize(resolved));
    vec4 current = vec4(drawn.between, texelFetch(color_hdr, drawn.pixel, 0).a);
    vec3 color = drawn.color;
    float weight = drawn.weight;
#else
    vec4 current = texelFetch(color_hdr, pixel, 0);
    vec3 color = current.rgb;
#endif
    float share = frame.previous_eye.w, ratio = exposure() / previous_exposure();
    if ((frame.valid_histories & HISTORY_COLOR) != 0u && share < 1.0) {
        if (frame.origin.w != 0.0) {
            vec3 before = texelFetch(history_color, pixel, 0).rgb * ratio;
            if (is_finite_color(before)) {
#ifdef SCALED
                float counted = frame.origin.w > 1.0 ? WEIGHT_BEFORE : texelFetch(history_weight, pixel, 0).r;
                weight = share > 0.0 ? counted + drawn.weight : counted;
                share = share > 0.0 ? drawn.weight / weight : 0.0;
#endif
                color = share > 0.0 ? before + (color - before) * share : before;
            }
        } else {
            color = blended(pixel, current, ratio);
#ifdef SCALED
            weight = WEIGHT_BEFORE;
#endif
        }
    }
    imageStore(resolved, pixel, vec4(color, inverse_distance(texelFetch(depth, DRAWN(pixel), 0).r)));
#ifdef SCALED
    imageStore(resolved_weight, pixel, vec4(weight));
#endif
}
