// Light of an environment as a surface reflects it: the split sum (Karis 2013, "Real Shading in Unreal Engine 4").
//
// The integral of radiance times BRDF is taken apart into two that can be made before: the radiance around the mirrored
// direction, blurred as the lobe of D is wide, and the BRDF in light that is the same from everywhere, a small table of
//
//     A, B   F0 A + B is the directional albedo of the specular part, Fresnel's F being F0 (1 - w) + w, w = (1 - v.h)^5
//     W      the mean of w over cosine-weighted light: what Fresnel takes from the diffuse part
//
// tests/twins/shading_environment.py has the same formulas in float64, and quadratures of what the table holds.

#include "brdf.glsl"
#include "environment.glsl"

// How the parts of the BRDF share the light. As printed in glTF 2.0, a rough metal loses what bounces between its facets,
// and a dielectric reflects more than it receives at grazing angles: its diffuse part knows nothing of the facets' lobe.
const int ENERGY_GLTF = 0;         // as printed
const int ENERGY_COMPENSATED = 1;  // and the light that bounces between facets (Fdez-Aguera 2019, JCGT 8(1))
const int ENERGY_CONSERVING = 2;   // and the diffuse part gets only what the specular part leaves

const float DIELECTRIC = 0.04;  // reflectance at normal incidence: index of refraction 1.5

// Where the table, of `size` columns and rows, has a cosine and a roughness. Columns stand for ((i + 0.5) / (size - 0.5))^2,
// since the albedo changes fastest at grazing angles, and 0 itself is 0/0 for a mirror; rows for j / (size - 1).
vec2 table_uv(float n_dot_v, float roughness, float size) {
    return vec2(sqrt(n_dot_v) * (size - 0.5), roughness * (size - 1.0) + 0.5) / size;
}

// What a column and a row of the table stand for: cosine and roughness.
vec2 table_point(uvec2 texel, uint size) {
    float x = (float(texel.x) + 0.5) / (float(size) - 0.5);
    return vec2(x * x, float(texel.y) / float(size - 1u));
}

// A and B without a table, off by up to 0.2 (Karis 2014, "Physically Based Shading on Mobile").
vec2 split_sum_fit(float n_dot_v, float roughness) {
    vec4 r = roughness * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
    float p = min(r.x * r.x, exp2(-9.28 * n_dot_v)) * r.x + r.y;
    return max(vec2(-1.04, 1.04) * p + r.zw, 0.0);
}

// Returns the specular albedo for reflectance `f0`, and in `more` what bounces between facets before it leaves.
vec3 specular_albedo(vec3 f0, vec3 table, int energy, out vec3 more) {
    vec3 once = f0 * table.x + table.y;
    float lost = max(1.0 - table.x - table.y, 0.0);
    vec3 mean = f0 + (1.0 - f0) * (1.0 / 21.0);  // Schlick's Fresnel averaged over the hemisphere
    more = energy == ENERGY_GLTF ? vec3(0.0) : lost * once * mean / (1.0 - mean * lost);
    return once;
}

// What the blurred radiance, and the irradiance / pi, are multiplied by. `table` is (A, B, W).
void environment_weights(
    vec3 base_color, float metallic, vec3 table, int energy, out vec3 on_radiance, out vec3 on_irradiance
) {
    vec3 more, metal_more;
    vec3 once = specular_albedo(vec3(DIELECTRIC), table, energy, more);
    vec3 metal_once = specular_albedo(base_color, table, energy, metal_more);
    vec3 left = energy == ENERGY_CONSERVING ? max(1.0 - once - more, 0.0) : vec3((1.0 - DIELECTRIC) * (1.0 - table.z));
    on_radiance = mix(once, metal_once, metallic);
    on_irradiance = mix(base_color * left + more, metal_more, metallic);
}

// The light that leaves towards `v`, in units of what the cube maps hold. Level l of `radiance` is blurred for the
// roughness l / last_level, `irradiance` holds irradiance / pi; `cos_sin` is how far the environment was turned about +y.
vec3 environment_light(
    samplerCube radiance, samplerCube irradiance, sampler2D table, vec3 n, vec3 v, vec3 base_color, float metallic,
    float roughness, int energy, float last_level, vec2 cos_sin
) {
    float n_dot_v = min(abs(dot(n, v)), 1.0);
    vec2 uv = table_uv(n_dot_v, roughness, float(textureSize(table, 0).y));
    vec3 on_radiance, on_irradiance;
    environment_weights(base_color, metallic, textureLod(table, uv, 0.0).rgb, energy, on_radiance, on_irradiance);
    vec3 mirrored = turned_back(reflect(-v, n), cos_sin);
    vec3 light = on_radiance * textureLod(radiance, mirrored, roughness * last_level).rgb;
    return light + on_irradiance * textureLod(irradiance, turned_back(n, cos_sin), 0.0).rgb;
}
