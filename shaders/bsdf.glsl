// Chapter 1's material for a path tracer: its value, directions drawn in proportion to its lobes, and their density.
//
// The value is the metallic-roughness BRDF of brdf.glsl. What a setting of energy (ibl.glsl) adds for an environment is
// here part of the BRDF, so that it holds for light of every kind:
//
//     ENERGY_GLTF         as brdf.glsl has it
//     ENERGY_COMPENSATED  and more / pi: light that bounces between facets leaves evenly
//     ENERGY_CONSERVING   the specular part, and (base_color * left + more) / pi in place of the diffuse part
//
// with `more` and `left` of ibl.glsl, mixed by metallic. Integrated over a uniform environment, value times cosine is
// exactly the sum of the two weights of `environment_weights`, since that table is the integral of the specular part.
// `more` and `left` depend on the direction of view alone: neither is reciprocal.
//
// There are two lobes: the visible normals of GGX, mirrored, and a cosine. Each is chosen in proportion to its albedo.
// Vectors are of unit length in the space of the normal. Mirrored directions below the horizon count in the density,
// and their value is 0. The same in float64: tests/twins/bsdf.py.

#include "ggx_sampling.glsl"
#include "ibl.glsl"

struct Bsdf {
    vec3 base_color;
    float metallic;
    float alpha;
    int energy;
    vec3 even;        // albedo of what is added as a Lambert lobe; 0 with ENERGY_GLTF
    float specular;   // probability of the lobe of GGX
};

struct BsdfSample {
    vec3 direction;
    float pdf;        // per solid angle
    vec3 weight;      // value times cosine over pdf; 0 below the horizon
};

// A, B and W without a table, good enough to choose lobes by: with ENERGY_GLTF the value does not depend on them.
vec3 albedo_fit(float n_dot_v, float roughness) {
    float m = 1.0 - n_dot_v;
    return vec3(split_sum_fit(n_dot_v, roughness), 0.005 + 0.12 * m * m * m);
}

// `table` is (A, B, W) of ibl.glsl for |n.v| and the roughness, `energy` one of its constants.
Bsdf bsdf_of(vec3 base_color, float metallic, float roughness, vec3 table, int energy) {
    vec3 on_radiance, on_irradiance;
    environment_weights(base_color, metallic, table, energy, on_radiance, on_irradiance);
    vec3 even = vec3(0.0);
    if (energy == ENERGY_CONSERVING) {
        even = on_irradiance;
    } else if (energy == ENERGY_COMPENSATED) {
        vec3 more, metal_more;
        specular_albedo(vec3(DIELECTRIC), table, energy, more);
        specular_albedo(base_color, table, energy, metal_more);
        even = more * (1.0 - metallic) + metal_more * metallic;
    }
    float mirrored = on_radiance.r + on_radiance.g + on_radiance.b;
    float sum = mirrored + on_irradiance.r + on_irradiance.g + on_irradiance.b;
    float specular = sum > 0.0 ? min(mirrored / sum, 1.0) : 1.0;
    return Bsdf(base_color, metallic, max(roughness * roughness, ALPHA_MIN), energy, even, specular);
}

// The BRDF times the cosine n.l, for light arriving from `l` that leaves towards `v`; 0 for light from behind.
vec3 bsdf_value(Bsdf b, vec3 n, vec3 l, vec3 v) {
    if (b.energy == ENERGY_GLTF) {
        return metallic_roughness(n, l, v, b.base_color, b.metallic, b.alpha);
    }
    vec3 even = b.even * (max(dot(n, l), 0.0) / PI);
    if (b.energy == ENERGY_COMPENSATED) {
        return metallic_roughness(n, l, v, b.base_color, b.metallic, b.alpha) + even;
    }
    vec3 black = metallic_roughness(n, l, v, vec3(0.0), 0.0, b.alpha);
    vec3 metal = metallic_roughness(n, l, v, b.base_color, 1.0, b.alpha);
    return black * (1.0 - b.metallic) + metal * b.metallic + even;
}

// `v` on the side of the normal. Normals of maps and of corners may turn away from a direction of view; lobes are then
// those of the direction mirrored at the surface, while the value is that of the direction itself.
vec3 above_surface(vec3 n, vec3 v) {
    return v - 2.0 * min(dot(n, v), 0.0) * n;
}

// The density per solid angle with which `bsdf_sample` returns direction `l`.
float bsdf_pdf(Bsdf b, vec3 n, vec3 l, vec3 v) {
    vec3 above = above_surface(n, v);
    vec3 sum = l + above;
    float length2 = dot(sum, sum);
    float mirrored = 0.0;
    if (length2 >= 1e-12) {
        mirrored = pdf_ggx(distribution_ggx(n, sum * inversesqrt(length2), b.alpha), abs(dot(n, v)), b.alpha);
    }
    return b.specular * mirrored + (1.0 - b.specular) * (max(dot(n, l), 0.0) / PI);
}

// A direction of arriving light for the direction of view `v`; `u` are uniform in [0, 1)^3, and u.x chooses the lobe.
BsdfSample bsdf_sample(vec3 u, Bsdf b, vec3 n, vec3 v) {
    mat3 frame = frame_around(n);
    vec3 local = v * frame;
    local.z = abs(local.z);
    vec3 l;
    if (u.x < b.specular) {
        vec3 h = sample_ggx(u.yz, local, b.alpha);
        l = 2.0 * dot(local, h) * h - local;
    } else {
        l = sample_cosine(u.yz);
    }
    vec3 direction = normalize(frame * l);
    float pdf = bsdf_pdf(b, n, direction, v);
    vec3 weight = pdf > 0.0 ? bsdf_value(b, n, direction, v) / pdf : vec3(0.0);
    return BsdfSample(direction, pdf, weight);
}
