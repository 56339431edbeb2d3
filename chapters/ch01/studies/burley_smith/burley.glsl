// Study burley-smith: metallic-roughness with Burley's diffuse part and Smith's masking, as many renderers write it.
//
// Vectors are unit length and point away from the surface; alpha is roughness squared. Where the chapter's own BRDF, glTF's, is
// another, it is said here.

#include "brdf.glsl"

struct Surface {
    vec3 diffuse;   // albedo of the matt part: metals have none
    vec3 specular;  // what is mirrored at normal incidence
    float alpha;
};

Surface surface_of(vec3 base_color, float metallic, float roughness) {
    float clamped = clamp(roughness, 0.04, 1.0);
    // 4 % is mirrored by everything that is no metal, and does not come back from within: 0.96 is left.
    vec3 diffuse = base_color * (1.0 - 0.04) * (1.0 - metallic);
    return Surface(diffuse, mix(vec3(0.04), base_color, metallic), clamped * clamped);
}

// B. Burley 2012, "Physically Based Shading at Disney", with alpha in place of roughness. A smooth surface is darker at
// its rim than Lambert's, a rough one brighter; at alpha 1 more light can come back than arrived (1.38 times, at grazing views).
float burley_diffuse(float n_dot_l, float n_dot_v, float l_dot_h, float alpha) {
    float f = 2.0 * l_dot_h * l_dot_h * alpha - 0.5;
    return (1.0 + f * schlick_weight(n_dot_l)) * (1.0 + f * schlick_weight(n_dot_v)) / PI;
}

// Reflected luminance for each lux of a light that the surface would get facing it.
vec3 burley_smith(Surface surface, vec3 n, vec3 l, vec3 v) {
    float n_dot_l = dot(n, l);
    if (n_dot_l <= 0.0) {
        return vec3(0.0);
    }
    float n_dot_v = clamp(abs(dot(n, v)), 0.001, 1.0);
    vec3 h = normalize(l + v);
    float v_dot_h = clamp(dot(v, h), 0.0, 1.0);
    // What mirrors less than 4 % is taken for something in shadow, and so grazing light gets no mirror from it either.
    float f90 = clamp(25.0 * max(surface.specular.r, max(surface.specular.g, surface.specular.b)), 0.0, 1.0);
    vec3 fresnel = surface.specular + (vec3(f90) - surface.specular) * schlick_weight(v_dot_h);
    // Smith's masking over 4 n.l n.v, and GGX, are those of the chapter.
    float mirror = visibility_ggx(n_dot_l, n_dot_v, surface.alpha) * distribution_ggx(n, h, surface.alpha);
    // (1 - fresnel) for each channel, where glTF has one for all.
    vec3 matt = (1.0 - fresnel) * surface.diffuse * burley_diffuse(n_dot_l, n_dot_v, v_dot_h, surface.alpha);
    return n_dot_l * (matt + fresnel * mirror);
}

// What an environment adds to the matt part, from every direction of view the same. `irradiance` is that around the normal
// divided by pi: the luminance of a white matt surface.
vec3 environment_diffuse(Surface surface, vec3 irradiance) {
    return surface.diffuse * irradiance;
}
