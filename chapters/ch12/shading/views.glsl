// What a view shows of a surface in place of its light: one function for each, chosen when the shader is compiled. The
// names and sentences are in shading/views.py, in the order of these numbers.

#include "palette.glsl"

#define VIEW_BASE_COLOR 0
#define VIEW_NORMAL 1
#define VIEW_ROUGHNESS 2
#define VIEW_METALNESS 3
#define VIEW_OCCLUSION 4
#define VIEW_EMISSIVE 5
#define VIEW_DEPTH 6
#define VIEW_UV 7
#define VIEW_MIP_LEVEL 8
#define VIEW_TRIANGLE_ID 9
#define VIEW_OVERDRAW 10
#define VIEW_LIGHT_COUNT 11
#define VIEW_NON_FINITE 12
#define VIEW_MESHLETS 13
#define VIEW_SURVIVORS 14
#define VIEW_LIGHTS_EVALUATED 15
#define VIEW_SHADOW_FACTOR 16
#define VIEW_CASCADE 17
#define VIEW_RESIDENCY 18
#define VIEW_SHADOW_RESOLUTION 19
#define VIEW_REDRAWN_PAGES 20
#define VIEW_FOG_SLICES 21
#define VIEW_FOG_TRANSMITTANCE 22

#if VIEW != VIEW_NON_FINITE
#define VIEW_OF_SURFACE  // nothing is lit
#endif

bool is_finite(vec3 value) {
    return !(any(isnan(value)) || any(isinf(value)));
}

#if VIEW == VIEW_ROUGHNESS || VIEW == VIEW_METALNESS || VIEW == VIEW_NON_FINITE
// Roughness and metalness as they are stored; the forward pass clamps them, and with that hides what is no number.
vec2 stored_factors(Material material) {
    vec2 factors = material.factors.yx;
#ifdef METALLIC_ROUGHNESS_MAP
    factors *= sample_map(metallic_roughness_map, image_uv(material, 1, in_uv0, in_uv1)).gb;
#endif
    return factors;
}
#endif

#if VIEW == VIEW_OCCLUSION
float shown_occlusion(Material material) {
#ifdef OCCLUSION_MAP
    float sampled = sample_map(occlusion_map, image_uv(material, 3, in_uv0, in_uv1)).r;
    return 1.0 + material.factors.w * (sampled - 1.0);
#else
    return 1.0;
#endif
}
#endif

#if VIEW == VIEW_EMISSIVE
vec3 shown_emission(Material material) {
    vec3 emissive = material.emissive.rgb;
#ifdef EMISSIVE_MAP
    emissive *= sample_map(emissive_map, image_uv(material, 4, in_uv0, in_uv1)).rgb;
#endif
    return emissive / max(1.0, max(emissive.r, max(emissive.g, emissive.b)));
}
#endif

#if VIEW == VIEW_DEPTH
float shown_depth() {
    vec4 in_view = frame.view_from_world * vec4(in_position, 1.0);
    float half_bright = 0.25 * frame.eye.w;
    return half_bright / (half_bright + max(-in_view.z, 0.0));
}
#endif

#if VIEW == VIEW_MIP_LEVEL
float shown_level(Material material) {
#ifdef BASE_COLOR_MAP
#ifdef MIP_BIAS
    return sampled_level(base_color_map, image_uv(material, 0, in_uv0, in_uv1)) + MIP_BIAS;
#else
    return sampled_level(base_color_map, image_uv(material, 0, in_uv0, in_uv1));
#endif
#else
    return -1.0;  // grey, see tonemap.frag
#endif
}
#endif

#if VIEW == VIEW_LIGHT_COUNT || VIEW == VIEW_LIGHTS_EVALUATED
float shown_light_count() {
    float count = 0.0;
#ifdef LIT
    LightWalk walk = first_light(in_position, gl_FragCoord.xy);
    for (uint i; next_light(walk, i);) {
        vec3 to_light;
        vec3 received = exposed_illuminance(i, in_position, to_light);
#if VIEW == VIEW_LIGHTS_EVALUATED
        received = vec3(1.0);
#endif
        count += max(received.r, max(received.g, received.b)) > 0.0 ? 1.0 : 0.0;
    }
#endif
    return count;
}
#endif

#if VIEW >= VIEW_SHADOW_FACTOR && VIEW <= VIEW_REDRAWN_PAGES
#include "shadows/views.glsl"
#endif

#if VIEW == VIEW_MESHLETS || VIEW == VIEW_SURVIVORS
// Differs a little between neighbours of one colour, so that they can be told apart: 0.75 to 1.
float own_brightness(uint meshlet) {
    return 0.75 + 0.25 * float(scrambled(part_id(in_instance, meshlet)) >> 24) / 255.0;
}
#endif

#if VIEW == VIEW_MESHLETS
vec3 shown_meshlet() {
    uint meshlet = in_code & 63u;
    return meshlet == 0u ? vec3(0.4 * own_brightness(0u)) : id_color(part_id(in_instance, meshlet));
}
#endif

#if VIEW == VIEW_SURVIVORS
vec3 shown_survivor() {
    uint meshlet = in_code & 63u;
#ifdef ALPHA_BLEND
    return vec3(0.4 * own_brightness(0u));  // drawn after both phases
#else
    vec3 color = (in_code & 64u) == 0u ? vec3(0.3, 0.6, 1.0) : vec3(1.0, 0.6, 0.1);
    return color * own_brightness(meshlet) * (meshlet == 0u ? 0.5 : 1.0);
#endif
}
#endif

#if VIEW == VIEW_FOG_SLICES || VIEW == VIEW_FOG_TRANSMITTANCE
#include "fog/views.glsl"
#endif

#if VIEW == VIEW_NON_FINITE
// Magenta where something of the surface or its `light` is no number, else the picture at a quarter of its light.
vec3 shown_non_finite(Material material, vec4 base, vec3 light) {
    bool fine = is_finite(base.rgb) && is_finite(vec3(base.a)) && is_finite(light) && is_finite(in_position);
#ifdef SHADED
    fine = fine && is_finite(in_normal) && is_finite(vec3(stored_factors(material), material.factors.z));
#ifdef NORMAL_MAP
    fine = fine && is_finite(sample_map(normal_map, image_uv(material, 2, in_uv0, in_uv1)).xyz);
#endif
#endif
    return fine ? 0.25 * min(light, 1.0) : vec3(1.0, 0.0, 1.0);
}
#else
// What the view shows of a surface with base colour `base`; `to_eye` points to the camera, with any length but 0.
vec3 shown(Material material, vec3 base, vec3 to_eye) {
#if VIEW == VIEW_BASE_COLOR
    return finite_color(base);
#elif VIEW == VIEW_NORMAL
    return 0.5 + 0.5 * shading_normal(material, normalize(to_eye));
#elif defined(UNLIT) && (VIEW == VIEW_ROUGHNESS || VIEW == VIEW_METALNESS || VIEW == VIEW_EMISSIVE)
    return vec3(0.0);
#elif VIEW == VIEW_ROUGHNESS
    return vec3(clamp(stored_factors(material).x, 0.0, 1.0));
#elif VIEW == VIEW_METALNESS
    return vec3(clamp(stored_factors(material).y, 0.0, 1.0));
#elif VIEW == VIEW_OCCLUSION
    return vec3(shown_occlusion(material));
#elif VIEW == VIEW_EMISSIVE
    return finite_color(shown_emission(material));
#elif VIEW == VIEW_DEPTH
    return vec3(shown_depth());
#elif VIEW == VIEW_UV
    return vec3(fract(in_uv0), 0.0);
#elif VIEW == VIEW_MIP_LEVEL
    return vec3(shown_level(material));
#elif VIEW == VIEW_TRIANGLE_ID
    // A meshlet numbers its triangles from 0 on, and has at most 124 of them.
    return id_color(part_id(in_instance, uint(gl_PrimitiveID) + ((in_code & 63u) << 7)));
#elif VIEW == VIEW_OVERDRAW
    return vec3(1.0);
#elif VIEW == VIEW_LIGHT_COUNT || VIEW == VIEW_LIGHTS_EVALUATED
    return vec3(shown_light_count());
#elif VIEW == VIEW_SHADOW_FACTOR
    return vec3(shown_shadow(normalize(to_eye)));
#elif VIEW == VIEW_CASCADE
    return shown_cascade();
#elif VIEW >= VIEW_RESIDENCY && VIEW <= VIEW_REDRAWN_PAGES
    return shown_map();
#elif VIEW == VIEW_FOG_SLICES
    return shown_slice();
#elif VIEW == VIEW_FOG_TRANSMITTANCE
    return shown_transmittance();
#elif VIEW == VIEW_MESHLETS
    return shown_meshlet();
#elif VIEW == VIEW_SURVIVORS
    return shown_survivor();
#else
#error an unknown view
#endif
}
#endif
