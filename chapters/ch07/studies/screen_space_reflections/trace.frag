// Study screen-space-reflections, the first pass: where the mirrored ray of each pixel ends in the picture.

#include "surface.glsl"
#include "march.glsl"

layout(location = 0) out vec4 out_hit;  // column, row; weight of the light there; 1 if the surface reflects

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_hit = vec4(0.0);
    float d = texelFetch(depth, pixel, 0).r;
    if (d == 0.0) {  // the sky: before anything else, since its depth is infinite and its G-buffer is not written
        return;
    }
    float mask = mask_of(texelFetch(gbuffer_material, pixel, 0));
    if (mask == 0.0) {
        return;
    }
    out_hit.w = 1.0;
    vec2 ndc = ndc_of(pixel);
    vec3 seen = eye_ray(ndc), n = mat3(frame.view_from_world) * normal_at(pixel);
    if (dot(seen, n) >= 0.0) {  // an interpolated normal may turn away from the eye at an outline
        return;
    }
    vec3 direction = reflect(seen, n);
    vec3 first = in_pixels(vec3(ndc, d)), last = in_pixels(end_of(ndc, d, direction));
    // A ray towards the eye, or straight away from it, stays within its pixel. The comparison is false for NaN as well.
    if (!(distance(first.xy, last.xy) >= 1.0)) {
        return;
    }
    vec2 place;
    if (march(first, last, mat3(frame.world_from_view) * direction, place)) {
        vec2 border = min(place, frame.size.xy - place) * frame.size.zw;
        out_hit.xy = place;
        out_hit.z = mask * clamp(min(border.x, border.y) / max(EDGE, 1e-6), 0.0, 1.0);
    }
}
