// The G-buffer (Saito and Takahashi 1990): what the nearest surface is at each pixel, kept until a later pass lights it.
//
//     0  base colour  rgb                                                          a: 1
//     1  normal       xyz, unit length, in the world, after the normal map
//     2  material     r: occlusion, g: roughness, b: metalness, as in glTF's maps  a: 1 if light counts, 0 if unlit
//     3  emission     rgb, times exposure; of what is unlit the colour itself
//
// A position is not kept: depth and the pixel say where it is. Nor is anything of a material that is folded in before:
// factors, textures, vertex colours, normal scale, occlusion strength, the side that is seen.

#include "color_code.glsl"
#include "normal_code.glsl"

#ifdef COMPUTED
#define TARGET(place)  // a variable, which the kernel stores to an image
#else
#define TARGET(place) layout(location = place) out
#endif
TARGET(0) vec4 out_base_color;
#ifdef NORMAL_OCTAHEDRAL
TARGET(1) uint out_normal;
#else
TARGET(1) vec4 out_normal;
#endif
TARGET(2) vec4 out_material;
#ifdef EMISSION
TARGET(3) vec4 out_emission;
#endif

void store_surface(vec3 base_color, vec3 n, float occlusion, float roughness, float metallic, vec3 emission) {
    out_base_color = vec4(kept_color(finite_color(base_color)), 1.0);
    out_normal = kept_normal(n);
    out_material = vec4(occlusion, roughness, metallic, 1.0);
#ifdef EMISSION
    out_emission = vec4(finite_color(emission), 0.0);
#endif
}

void store_unlit(vec3 color) {
    out_base_color = vec4(kept_color(finite_color(color)), 1.0);
    out_normal = NO_NORMAL;
    out_material = vec4(0.0);
#ifdef EMISSION
    out_emission = vec4(finite_color(color), 0.0);
#endif
}
