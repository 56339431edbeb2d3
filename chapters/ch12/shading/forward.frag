// Forward pass, fragments: glTF 2.0's metallic-roughness material under every punctual light of the scene.

#include "scene/scene.glsl"
#include "clusters/walk.glsl"
#include "shadows/factor.glsl"
#include "material.glsl"
#include "finite.glsl"
#include "fog/apply.glsl"
#ifdef SHADED
#include "brdf.glsl"
#endif
#ifdef ENVIRONMENT
#include "ibl.glsl"
#endif

layout(location = 0) in vec3 in_position;
#ifdef SHADED
layout(location = 1) in vec3 in_normal;
#endif
#ifdef NORMAL_MAP
layout(location = 2) in vec4 in_tangent;
#endif
#ifdef TEXTURED
layout(location = 3) in vec2 in_uv0;
#else
const vec2 in_uv0 = vec2(0.0);
#endif
#ifdef UV1
layout(location = 4) in vec2 in_uv1;
#else
const vec2 in_uv1 = vec2(0.0);
#endif
#ifdef VERTEX_COLOR
layout(location = 5) in vec4 in_color;
#endif
layout(location = 6) flat in uint in_instance;
#ifdef UNIT_CODE
layout(location = 7) flat in uint in_code;
#endif

#ifdef GBUFFER
#include "gbuffer.glsl"
#elif defined(LAYERS)
#include "transparency/layers.glsl"
#elif !defined(DEPTH_ALONE)
layout(location = 0) out vec4 out_color;
#endif

#ifdef SHADED
// The shading normal. `view` points to the eye. A back face of a double-sided material is shaded as if it were a front.
vec3 shading_normal(Material material, vec3 view) {
    // A normal that cannot be normalised (zero-area triangle, singular transform) is replaced: no NaN leaves a shader.
    float length2 = dot(in_normal, in_normal);
    vec3 n = length2 > 0.0 ? in_normal * inversesqrt(length2) : view;
#ifdef NORMAL_MAP
    vec3 sampled = sample_map(normal_map, image_uv(material, 2, in_uv0, in_uv1)).xyz * 2.0 - 1.0;
    sampled.xy *= material.factors.z;
    vec3 t = in_tangent.xyz - n * dot(n, in_tangent.xyz);
    float t2 = dot(t, t);
    if (t2 > 0.0) {
        t *= inversesqrt(t2);
        vec3 b = cross(n, t) * in_tangent.w;
        vec3 mapped = sampled.x * t + sampled.y * b + sampled.z * n;
        float m2 = dot(mapped, mapped);
        n = m2 > 0.0 ? mapped * inversesqrt(m2) : n;
    }
#endif
#ifdef DOUBLE_SIDED
    n = gl_FrontFacing ? n : -n;
#endif
    return n;
}
#endif

#ifdef VIEW
#include "views.glsl"
#endif

void main() {
    Instance instance = instance_of(in_instance);
    Material material = materials[instance.material];

    vec4 base = material.base_color;
#ifdef VERTEX_COLOR
    base *= in_color;
#endif
#ifdef BASE_COLOR_MAP
    base *= sample_map(base_color_map, image_uv(material, 0, in_uv0, in_uv1));
#endif
#if defined(ALPHA_MASK) && defined(COVERAGE_SAMPLES)
    // The cutoff is crossed about (alpha - cutoff) / |gradient| pixels from here: that much more or less than half of
    // the pixel is covered. Which samples stand for it is said here and not left to the driver's alpha-to-coverage.
    float inside = (base.a - material.emissive.a) / max(fwidth(base.a), 1e-6) + 0.5;
    int covered = int(clamp(inside, 0.0, 1.0) * float(COVERAGE_SAMPLES) + 0.5);
    if (covered == 0) {
        discard;
    }
    gl_SampleMask[0] = (1 << covered) - 1;
#elif defined(ALPHA_MASK)
    if (base.a < material.emissive.a) {
        discard;
    }
#endif
#ifndef ALPHA_BLEND
    base.a = 1.0;
#endif

#ifndef DEPTH_ALONE
#ifdef VIEW_OF_SURFACE
    out_color = vec4(shown(material, base.rgb, frame.eye.xyz - in_position), 1.0);
#else
#ifndef SHADED
    // KHR_materials_unlit: the base colour is what the eye sees, whatever the exposure.
    vec3 color = base.rgb;
#else
    float metallic = material.factors.x;
    float roughness = material.factors.y;
#ifdef METALLIC_ROUGHNESS_MAP
    vec4 factors = sample_map(metallic_roughness_map, image_uv(material, 1, in_uv0, in_uv1));
    roughness *= factors.g;
    metallic *= factors.b;
#endif
    roughness = clamp(roughness, 0.0, 1.0);
    metallic = clamp(metallic, 0.0, 1.0);
    float alpha = max(roughness * roughness, ALPHA_MIN);

    // An orthographic view has no eye, only a direction: the camera's +z axis, against which it looks.
    vec3 to_eye = frame.orthographic != 0u ? frame.world_from_view[2].xyz : frame.eye.xyz - in_position;
    vec3 view = to_eye * inversesqrt(max(dot(to_eye, to_eye), 1e-30));
    vec3 n = shading_normal(material, view);

    vec3 color = vec3(0.0);
#ifdef LIT
    LightWalk walk = first_light(in_position, gl_FragCoord.xy);
    for (uint i; next_light(walk, i);) {
        vec3 to_light;
        vec3 received = exposed_illuminance(i, in_position, to_light);
        if (max(received.r, max(received.g, received.b)) > 0.0) {
            received *= shadow_factor(i, in_position, n);
            color += received * metallic_roughness(n, to_light, view, base.rgb, metallic, alpha);
        }
    }
#endif

    // Light from everywhere alike, the stand-in for what this chapter does not simulate: it is reflected by the albedo,
    // and it alone is dimmed by occlusion, which says nothing about lights whose direction is known.
    float occlusion = 1.0;
#ifdef OCCLUSION_MAP
    float sampled = sample_map(occlusion_map, image_uv(material, 3, in_uv0, in_uv1)).r;
    occlusion += material.factors.w * (sampled - 1.0);
#endif
    vec3 albedo = mix(0.96 * base.rgb + 0.04, base.rgb, metallic);
    color += frame.ambient.rgb * exposure() * occlusion * albedo;
#ifdef ENVIRONMENT
    color += frame.environment.x * exposure() * occlusion * environment_light(
        environment_radiance, environment_irradiance, environment_table, n, view, base.rgb, metallic, roughness, ENERGY,
        frame.environment.w, frame.environment.yz
    );
#endif

    vec3 emissive = material.emissive.rgb;
#ifdef EMISSIVE_MAP
    emissive *= sample_map(emissive_map, image_uv(material, 4, in_uv0, in_uv1)).rgb;
#endif
    color += emissive * exposure();
#endif
#ifdef VIEW
    color = shown_non_finite(material, base, color);
#endif
#if defined(GBUFFER) && defined(SHADED)
    store_surface(base.rgb, n, occlusion, roughness, metallic, emissive * exposure());
#elif defined(GBUFFER)
    store_unlit(base.rgb);
#elif defined(LAYERS)
    store_layer(finite_color(fog_over(color, in_position, ivec2(gl_FragCoord.xy))), base.a);
#else
    out_color = vec4(finite_color(fog_over(color, in_position, ivec2(gl_FragCoord.xy))), base.a);
#endif
#endif
#endif
}
