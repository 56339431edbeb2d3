// Materials: one record each, which says by number what each role samples. Roles that a material lacks cost nothing: the
// pipeline is built without them, and then there is no fetch.

#ifdef TEXTURED
#include "textures.glsl"

#define base_color_map material.maps[0].x
#define metallic_roughness_map material.maps[0].y
#define normal_map material.maps[0].z
#define occlusion_map material.maps[0].w
#define emissive_map material.maps[1].x

// A map at `uv`. Where uv does not change over the picture (a palette, a collapsed patch) there is no footprint to filter,
// and an anisotropic filter divides zero by zero: some drivers then return NaN.
vec4 sample_map(uint map, vec2 uv) {
    vec4 filtered = sample_texture(map, uv);
    return fwidth(uv) == vec2(0.0) ? sample_finest(map, uv) : filtered;
}
#endif

// Where role number `role` samples its image: the uv set it names, through KHR_texture_transform.
vec2 image_uv(Material material, int role, vec2 uv0, vec2 uv1) {
    vec4 row0 = material.uv_rows[2 * role];
    vec4 row1 = material.uv_rows[2 * role + 1];
    vec3 uv = vec3(row0.w > 0.5 ? uv1 : uv0, 1.0);
    return vec2(dot(row0.xyz, uv), dot(row1.xyz, uv));
}
