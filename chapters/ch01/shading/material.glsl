// Materials: one record each, and the textures of the one that is bound. Roles that a material lacks cost nothing: the
// pipeline is built without them, and then neither descriptor nor sampler nor fetch exists.

struct Material {
    vec4 base_color;
    vec4 emissive;      // rgb in nits, a: alpha cutoff
    vec4 factors;       // metallic, roughness, normal scale, occlusion strength
    vec4 uv_rows[10];   // two rows for each role: xyz of the 2x3 matrix image_from_uv; w of the first: uv set
};
layout(BIND(0, 2, 1), std430) readonly buffer Materials_ { Material materials[]; };

#ifdef BASE_COLOR_MAP
layout(BIND(1, 0, 0)) uniform sampler2D base_color_map;
#endif
#ifdef METALLIC_ROUGHNESS_MAP
layout(BIND(1, 1, 1)) uniform sampler2D metallic_roughness_map;
#endif
#ifdef NORMAL_MAP
layout(BIND(1, 2, 2)) uniform sampler2D normal_map;
#endif
#ifdef OCCLUSION_MAP
layout(BIND(1, 3, 3)) uniform sampler2D occlusion_map;
#endif
#ifdef EMISSIVE_MAP
layout(BIND(1, 4, 4)) uniform sampler2D emissive_map;
#endif

// A map at `uv`. Where uv does not change over the picture (a palette, a collapsed patch) there is no footprint to filter,
// and an anisotropic filter divides zero by zero: some drivers then return NaN.
vec4 sample_map(sampler2D map, vec2 uv) {
    vec4 filtered = texture(map, uv);
    return fwidth(uv) == vec2(0.0) ? textureLod(map, uv, 0.0) : filtered;
}

// Where role number `role` samples its image: the uv set it names, through KHR_texture_transform.
vec2 image_uv(Material material, int role, vec2 uv0, vec2 uv1) {
    vec4 row0 = material.uv_rows[2 * role];
    vec4 row1 = material.uv_rows[2 * role + 1];
    vec3 uv = vec3(row0.w > 0.5 ? uv1 : uv0, 1.0);
    return vec2(dot(row0.xyz, uv), dot(row1.xyz, uv));
}
