// Ambient occlusion from what is seen around a pixel: the depth alone, or with the normals of the G-buffer.
//
// The picture shows the part that is visible.

#include "places.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D depth;
#ifdef NORMALS
#include "shading/normal_code.glsl"
layout(BIND(1, 1, 4)) uniform NORMAL_SAMPLER gbuffer_normal;
#endif

layout(constant_id = 0) const float OCCLUSION_RADIUS = 0.03;  // how far surfaces occlude, in length scales of the scene

layout(location = 0) out float out_visibility;

#ifdef NORMALS
layout(constant_id = 1) const uint RAY_STEPS = 4u;

// The part of eight rays that end behind no surface that is seen, to be tested at RAY_STEPS points each. These lie closer
// together near the pixel, where a small thing hides much, and elsewhere in each pixel of a block.
float visible_part(ivec2 pixel, vec3 place, float radius) {
    vec3 stored = found_normal(gbuffer_normal, pixel);
    if (stored == vec3(0.0)) {  // unlit: it has no normal, and takes no light from anywhere
        return 1.0;
    }
    vec3 n = normalize(transpose(mat3(frame.world_from_view)) * stored);
    uint index = pattern_index(uvec2(pixel));
    float turn = 6.2831853 * float(index) / 16.0;
    uint hidden = 0u;
    for (uint ray = 0u; ray < 8u; ++ray) {
        vec3 direction = around_normal(hemisphere_direction(ray, turn), n);
        float shift = (float((index * 5u + ray * 11u) & 15u) + 0.5) / 16.0;
        for (uint number = 0u; number < RAY_STEPS; ++number) {
            float part = (float(number) + shift) / float(RAY_STEPS);
            vec3 at = place + radius * part * sqrt(part) * direction;
            vec2 seen = floor(seen_at(at));
            if (any(lessThan(seen, vec2(0.0))) || any(greaterThanEqual(seen, frame.size.xy))) {
                break;  // outside of the picture nothing is known
            }
            float d = texelFetch(depth, ivec2(seen), 0).r;
            // The sky is behind everything. A pixel hides nothing of itself: if a compiler rounds `surface` and `place`
            // in two ways, they are apart by a rounding that points anywhere.
            if (d == 0.0 || ivec2(seen) == pixel) {
                continue;
            }
            vec3 surface = place_of(ivec2(seen), d);
            if (hides((surface.z - at.z) / radius, (surface - place) / radius, n)) {
                ++hidden;
                break;
            }
        }
    }
    return 1.0 - float(hidden) / 8.0;
}
#else
// From eight surfaces around the pixel: how much nearer to the eye each one is. Beyond the picture lies more of its rim.
float visible_part(ivec2 pixel, vec3 place, float radius) {
    vec3 about = rotation_vector(uvec2(pixel));
    float own = distance_of(texelFetch(depth, pixel, 0).r);
    float sum = 0.0;
    for (uint number = 0u; number < 8u; ++number) {
        vec2 seen = seen_at(place + vec3(radius * sample_offset(number, about).xy, 0.0));
        float d = texelFetch(depth, ivec2(clamp(seen, vec2(0.0), frame.size.xy - 1.0)), 0).r;
        sum += d == 0.0 ? 1.0 : sample_visibility((own - distance_of(d)) / radius);
    }
    return visibility_of_sum(sum);
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, pixel, 0).r;
    // Infinitely far nothing is hidden, and nothing may be divided by this depth.
    out_visibility = d == 0.0 ? 1.0 : visible_part(pixel, place_of(pixel, d), OCCLUSION_RADIUS * frame.eye.w);
}
