// Study screen-space-reflections, the second pass: the light at the places that were found, over a box that grows with
// roughness, in place of what came from the environment.

#include "surface.glsl"
#include "shading/color_code.glsl"

layout(BIND(1, 3, 6)) uniform sampler2D gbuffer_base_color;
layout(BIND(1, 4, 7)) uniform sampler2D color_lit;
layout(BIND(1, 5, 8)) uniform sampler2D reflection_hits;
#ifdef OCCLUSION_SCALE
#include "ambient_occlusion.glsl"
layout(BIND(1, 6, 9)) uniform sampler2D ambient_occlusion;
#endif

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

// The mean over the box around `pixel` of the light at the neighbours' places: rgb times its weight, and the weight. What
// does not reflect is left out; a ray that met nothing counts, with weight 0.
vec4 mean_light(ivec2 pixel, float roughness) {
    int radius = int(floor(BLUR * roughness + 0.5));
    ivec2 size = ivec2(frame.size.xy);
    ivec2 low = max(pixel - radius, 0), high = min(pixel + radius, size - 1);
    vec4 sum = vec4(0.0);
    float count = 0.0;
    for (int row = low.y; row <= high.y; row++) {
        for (int column = low.x; column <= high.x; column++) {
            vec4 hit = texelFetch(reflection_hits, ivec2(column, row), 0);
            if (hit.z > 0.0) {
                ivec2 place = clamp(ivec2(hit.xy), ivec2(0), size - 1);
                sum += vec4(texelFetch(color_lit, place, 0).rgb, 1.0) * hit.z;
            }
            count += hit.w;
        }
    }
    return sum / count;  // the pixel itself reflects
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_color = texelFetch(color_lit, pixel, 0);
    if (texelFetch(reflection_hits, pixel, 0).w == 0.0) {
        return;
    }
    vec4 material = texelFetch(gbuffer_material, pixel, 0);
    float occlusion = material.r, roughness = material.g, metallic = material.b;
#ifdef OCCLUSION_SCALE
    occlusion *= ambient_factor(texelFetch(ambient_occlusion, pixel, 0).r, OCCLUSION_BIAS, OCCLUSION_SCALE);
#endif
    vec4 mean = mean_light(pixel, roughness);
    if (mean.a == 0.0) {  // nothing was met: the environment stays, to the bit
        return;
    }
    vec3 base_color = found_color(gbuffer_base_color, pixel);
    vec3 n = normal_at(pixel), v = -(mat3(frame.world_from_view) * eye_ray(ndc_of(pixel)));
    vec3 f0 = mix(vec3(DIELECTRIC), base_color, metallic);
    float n_dot_v = min(abs(dot(n, v)), 1.0);
    // What lighting.frag added for the mirrored direction: a surface between reflects in its place.
    vec3 from_afar = f0 * frame.ambient.rgb * exposure();
#ifdef ENVIRONMENT
    vec3 reflected, scattered;
    vec2 uv = table_uv(n_dot_v, roughness, float(textureSize(environment_table, 0).y));
    vec3 table = textureLod(environment_table, uv, 0.0).rgb;
    environment_weights(base_color, metallic, table, ENERGY, reflected, scattered);
    vec3 mirrored = turned_back(reflect(-v, n), frame.environment.yz);
    vec3 radiance = textureLod(environment_radiance, mirrored, roughness * frame.environment.w).rgb;
    from_afar += reflected * frame.environment.x * exposure() * radiance;
#else
    vec3 reflected = f0 + (1.0 - f0) * schlick_weight(n_dot_v);  // a scene without environment has no table
#endif
    out_color.rgb = finite_color(out_color.rgb + reflected * mean.rgb - mean.a * occlusion * from_afar);
}
