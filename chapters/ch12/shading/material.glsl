// Materials: one record each, which says by number what each role samples. Roles that a material lacks cost nothing: the
// pipeline is built without them, and then there is no fetch.

#if defined(BINDLESS) || defined(ARRAYS) // a material with uv may sample nothing: a view shows them alone
#include "scene/textures/textures.glsl"

// In which arrays its materials have textures of each role, a bit an array: a shader has no code for the others.
#ifndef ROLE_ARRAYS
#define ROLE_ARRAYS uint[5](~0u, ~0u, ~0u, ~0u, ~0u)
#endif

// Two arguments each: the texture's number in the material's record, and where to look for it.
#define base_color_map material.maps[0].x, ROLE_ARRAYS[0]
#define metallic_roughness_map material.maps[0].y, ROLE_ARRAYS[1]
#define normal_map material.maps[0].z, ROLE_ARRAYS[2]
#define occlusion_map material.maps[0].w, ROLE_ARRAYS[3]
#define emissive_map material.maps[1].x, ROLE_ARRAYS[4]

#ifndef COMPUTED
// A map at `uv`. Where uv does not change over the picture (a palette, a collapsed patch) there is no footprint to filter,
// and an anisotropic filter divides zero by zero: some drivers then return NaN.
vec4 sample_map(uint map, uint arrays, vec2 uv) {
    vec4 filtered = sample_texture(map, arrays, uv);
    return fwidth(uv) == vec2(0.0) ? sample_finest(map, arrays, uv) : filtered;
}
#endif
#endif

#if defined(STEADY_UV) && !defined(COMPUTED) && !defined(STEADY_VIEW)
#include "taa/unjitter.glsl"
#define STEADY(uv) unjittered(uv, 0.5 * frame.jitter * frame.size.xy)
#else
#define STEADY(uv) (uv)
#endif

// Where role number `role` samples its image: the uv set it names, through KHR_texture_transform.
vec2 image_uv(Material material, int role, vec2 uv0, vec2 uv1) {
    vec4 row0 = material.uv_rows[2 * role];
    vec4 row1 = material.uv_rows[2 * role + 1];
    vec3 uv = vec3(row0.w > 0.5 ? uv1 : uv0, 1.0);
    return STEADY(vec2(dot(row0.xyz, uv), dot(row1.xyz, uv)));
}
