// Deferred lighting: each pixel's surface comes out of the G-buffer and is lit once, whatever lay behind it.
//
// The light is that of forward.frag, summed in the same order: with 32 bits in each channel of the G-buffer, the two
// paths differ by the rounding of a position that is found again from its depth.

#include "scene/scene.glsl"
#include "clusters/walk.glsl"
#include "shadows/factor.glsl"
#include "brdf.glsl"
#include "finite.glsl"
#include "color_code.glsl"
#include "normal_code.glsl"
#include "fog/apply.glsl"
#ifdef ENVIRONMENT
#include "ibl.glsl"
#endif

layout(BIND(1, 0, 3)) uniform sampler2D gbuffer_base_color;
layout(BIND(1, 1, 4)) uniform NORMAL_SAMPLER gbuffer_normal;
layout(BIND(1, 2, 5)) uniform sampler2D gbuffer_material;
layout(BIND(1, 3, 6)) uniform sampler2D depth;
#ifdef EMISSION
layout(BIND(1, 4, 7)) uniform sampler2D gbuffer_emissive;
#define FREE_BINDING 5
#else
#define FREE_BINDING 4
#endif
#ifdef OCCLUSION_SCALE
#include "ambient_occlusion.glsl"
layout(BIND(1, FREE_BINDING, FREE_BINDING + 3)) uniform sampler2D ambient_occlusion;
#endif

#ifdef SKY
// The sky's own shader, called as a function where nothing was drawn; in_uv and out_color are declared there.
#define main sky
#include "sky.frag"
#undef main
#else
#ifndef COMPUTED
layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;
#endif

void sky() {
    out_color = vec4(fog_behind(vec3(BACKGROUND), in_uv), 1.0);
}
#endif

// Where in the world, relative to its origin, the surface is that was seen at the middle of `pixel` at depth `d`.
vec3 position_of(ivec2 pixel, float d) {
    vec2 ndc = (vec2(pixel) + 0.5) * (2.0 * frame.size.zw) - 1.0;
    vec4 in_view = frame.view_from_clip * vec4(ndc, d, 1.0);
    return (frame.world_from_view * vec4(in_view.xyz / in_view.w, 1.0)).xyz;
}

#ifdef COMPUTED  // by lighting.comp, which calls what follows for the pixel of each invocation
#define main light
#elif defined(BY_RATES)  // the middle of a block that stands over the edge may lie outside
#define PIXEL min(gl_FragCoord.xy, frame.size.xy - 0.5)
#else
#define PIXEL gl_FragCoord
#endif

void main() {
    ivec2 pixel = ivec2(PIXEL.xy);
    float d = texelFetch(depth, pixel, 0).r;
    if (d == 0.0) {  // infinitely far: nothing was drawn, and nothing may be divided by it
        sky();
        return;
    }
    vec3 base_color = found_color(gbuffer_base_color, pixel);
    vec4 material = texelFetch(gbuffer_material, pixel, 0);
    vec3 color = vec3(0.0);
    if (material.a > 0.5) {
        vec3 position = position_of(pixel, d);
        float occlusion = material.r;
#ifdef OCCLUSION_SCALE
        float visible = texelFetch(ambient_occlusion, pixel, 0).r;
        occlusion *= ambient_factor(visible, OCCLUSION_BIAS, OCCLUSION_SCALE);
#endif
        float roughness = material.g;
        float metallic = material.b;
        float alpha = max(roughness * roughness, ALPHA_MIN);
        vec3 to_eye = frame.orthographic != 0u ? frame.world_from_view[2].xyz : frame.eye.xyz - position;
        vec3 view = to_eye * inversesqrt(max(dot(to_eye, to_eye), 1e-30));
        vec3 n = normalize(found_normal(gbuffer_normal, pixel));
#ifdef LIT
        LightWalk walk = first_light(position, vec2(pixel));
        for (uint i; next_light(walk, i);) {
            vec3 to_light;
            vec3 received = exposed_illuminance(i, position, to_light);
            if (max(received.r, max(received.g, received.b)) > 0.0) {
                received *= shadow_factor(i, position, n);
                color += received * metallic_roughness(n, to_light, view, base_color, metallic, alpha);
            }
        }
#endif
        color += frame.ambient.rgb * exposure() * occlusion * mix(0.96 * base_color + 0.04, base_color, metallic);
#ifdef ENVIRONMENT
        color += frame.environment.x * exposure() * occlusion * environment_light(
            environment_radiance, environment_irradiance, environment_table, n, view, base_color, metallic, roughness,
            ENERGY, frame.environment.w, frame.environment.yz
        );
#endif
    }
#ifdef EMISSION
    color += texelFetch(gbuffer_emissive, pixel, 0).rgb;
#endif
    out_color = vec4(finite_color(fog_over_half(color, position_of(pixel, d), pixel)), 1.0);
}
