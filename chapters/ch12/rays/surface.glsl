// The surface at a hit: attributes of the triangle's vertices, mixed by barycentric coordinates, and the material there.
//
// A ray has no neighbours from which the footprint of a texture would follow, so every map is sampled at its finest level.

#ifndef COMPUTED
#define COMPUTED
#endif
#include "rays/ray.glsl"
#include "scene/scene.glsl"
#include "scene/vertices.glsl"
#include "shading/material.glsl"
#include "transform.glsl"
#include "ray_offset.glsl"
#if defined(NORMAL_MAP) && defined(TANGENTS_DERIVED)
#include "visibility/cotangent.glsl"
#endif

struct Surface {
    SurfacePoint at;   // where rays that leave it begin
    vec3 flat_normal;  // of the triangle, towards the side that the ray comes from
    vec3 normal;       // for shading, after the normal map
    vec3 base_color;
    float metallic;
    float roughness;
    float occlusion;
    vec3 emission;     // exposed; the colour itself if `lit` is false
    bool lit;
};

// The corners of a triangle as numbers of vertices of its mesh.
uvec3 corners_of(Mesh mesh, uint primitive) {
    uint first = mesh.streams[1].z + 3u * primitive;
    return uvec3(words[first], words[first + 1u], words[first + 2u]);
}

// The sum of an attribute at three vertices. The first one is the rest, so equal attributes keep their bits.
vec2 at_hit(vec2 a, vec2 b, vec2 c, vec2 at) { return a + (b - a) * at.x + (c - a) * at.y; }
vec3 at_hit(vec3 a, vec3 b, vec3 c, vec2 at) { return a + (b - a) * at.x + (c - a) * at.y; }
vec4 at_hit(vec4 a, vec4 b, vec4 c, vec2 at) { return a + (b - a) * at.x + (c - a) * at.y; }

vec2 mixed2(uint stream, uvec3 v, vec2 at) {
    return at_hit(fetch2(stream, v.x), fetch2(stream, v.y), fetch2(stream, v.z), at);
}

vec3 mixed3(uint stream, uvec3 v, vec2 at) {
    return at_hit(fetch3(stream, v.x), fetch3(stream, v.y), fetch3(stream, v.z), at);
}

vec4 mixed4(uint stream, uvec3 v, vec2 at) {
    return at_hit(fetch4(stream, v.x), fetch4(stream, v.y), fetch4(stream, v.z), at);
}

#ifdef TEXTURED
vec2 hit_uv[2] = vec2[2](vec2(0.0), vec2(0.0));  // both sets at the hit

void find_uv(Mesh mesh, uvec3 v, vec2 at) {
    hit_uv[0] = mixed2(mesh.streams[0].w, v, at);
#ifdef UV1
    hit_uv[1] = mixed2(mesh.streams[1].x, v, at);
#endif
}

vec4 map_at_hit(Material material, int role) {
    uint map = material.maps[role >> 2][role & 3];
    return sample_finest(map, ROLE_ARRAYS[role], image_uv(material, role, hit_uv[0], hit_uv[1]));
}

// All maps of a material, by role; white where it has none. One call in a loop is one copy of the code that samples: software
// drivers take seconds to compile five.
void find_maps(Material material, uint flags, out vec4 maps[5]) {
    maps = vec4[5](vec4(1.0), vec4(1.0), vec4(0.5, 0.5, 1.0, 1.0), vec4(1.0), vec4(1.0));
    for (uint left = flags & 31u; left != 0u; left &= left - 1u) {
        int role = findLSB(left);
        maps[role] = map_at_hit(material, role);
    }
}
#endif

// The colour of vertices times that of the material; without its map.
vec4 tint_of(Mesh mesh, Material material, uvec3 v, vec2 at) {
    vec4 base = material.base_color;
#ifdef VERTEX_COLOR
    base *= mixed4(mesh.streams[1].y, v, at);
#endif
    return base;
}

// The alpha of a candidate, while a traversal still runs.
float alpha_of(Hit hit, Instance instance, Material material) {
    Mesh mesh = meshes[instance.mesh];
    uvec3 v = corners_of(mesh, hit.primitive);
    vec4 base = tint_of(mesh, material, v, hit.at);
#ifdef BASE_COLOR_MAP
    if ((uint(material.uv_rows[1].w) & 1u) != 0u) {
        find_uv(mesh, v, hit.at);
        base *= map_at_hit(material, 0);
    }
#endif
    return base.a;
}

#ifdef NORMAL_MAP
// The normal that the texel `map` of a triangle with these corners and coordinates turns `n` into; `n` where there is no tangent.
vec3 mapped_normal(Instance instance, Mesh mesh, Material material, uvec3 v, vec2 at, vec3 n, vec3 map) {
#ifdef TANGENTS_DERIVED
    uint stream = material.uv_rows[4].w > 0.5 ? mesh.streams[1].x : mesh.streams[0].w;
    vec3 a = transform_point(instance.world_from_object, fetch3(mesh.streams[0].x, v.x));
    vec3 along = transform_point(instance.world_from_object, fetch3(mesh.streams[0].x, v.y)) - a;
    vec3 across = transform_point(instance.world_from_object, fetch3(mesh.streams[0].x, v.z)) - a;
    vec2 first = fetch2(stream, v.x);
    Frame3 derived = cotangent_frame(n, along, across, fetch2(stream, v.y) - first, fetch2(stream, v.z) - first);
    vec3 t = derived.tangent, bitangent = -derived.bitangent;  // glTF's green points up, and its v down
#else
    vec4 tangent = mixed4(mesh.streams[0].z, v, at);
    vec3 t = transform_vector(instance.world_from_object, tangent.xyz);
    t -= n * dot(n, t);
    float t2 = dot(t, t);
    t *= t2 > 0.0 ? inversesqrt(t2) : 0.0;
    vec3 bitangent = cross(n, t) * ((instance.flags & INSTANCE_MIRRORED) != 0u ? -tangent.w : tangent.w);
#endif
    vec3 texel = map * 2.0 - 1.0;
    vec3 mapped = texel.x * material.factors.z * t + texel.y * material.factors.z * bitangent + texel.z * n;
    float m2 = t == vec3(0.0) ? 0.0 : dot(mapped, mapped);
    return m2 > 0.0 ? mapped * inversesqrt(m2) : n;
}
#endif

Surface surface_at(Hit hit, vec3 direction) {
    Surface found;
    Instance instance = instance_of(hit.instance);
    Mesh mesh = meshes[instance.mesh];
    Material material = materials[instance.material];
    uint flags = uint(material.uv_rows[1].w);
    uvec3 v = corners_of(mesh, hit.primitive);
    vec3 a = fetch3(mesh.streams[0].x, v.x), b = fetch3(mesh.streams[0].x, v.y), c = fetch3(mesh.streams[0].x, v.z);
    found.at = surface_point(instance.world_from_object, a, b, c, hit.at);
    found.flat_normal = dot(found.at.normal, direction) > 0.0 ? -found.at.normal : found.at.normal;
    found.base_color = tint_of(mesh, material, v, hit.at).rgb;
#ifdef TEXTURED
    vec4 maps[5];
    find_uv(mesh, v, hit.at);
    find_maps(material, flags, maps);
    found.base_color *= maps[0].rgb;
#else
    const vec4 maps[5] = vec4[5](vec4(1.0), vec4(1.0), vec4(1.0), vec4(1.0), vec4(1.0));
#endif
    found.lit = false;
    found.emission = found.base_color;
    found.normal = found.flat_normal;
    found.metallic = material.factors.x * maps[1].b;
    found.roughness = material.factors.y * maps[1].g;
    found.occlusion = 1.0 + material.factors.w * (maps[3].r - 1.0);
#ifdef SHADED
    if ((flags & uint(UNLIT_FLAG)) == 0u) {
        found.lit = true;
        found.emission = material.emissive.rgb * maps[4].rgb * exposure();
        vec3 n = transform_vector(instance.normal_from_object, mixed3(mesh.streams[0].y, v, hit.at));
        float n2 = dot(n, n);
        n = n2 > 0.0 ? n * inversesqrt(n2) : found.flat_normal;
#ifdef NORMAL_MAP
        if ((flags & 4u) != 0u) {
            n = mapped_normal(instance, mesh, material, v, hit.at, n, maps[2].xyz);
        }
#endif
        bool behind = (hit.flags & HIT_BACK) != 0u;
        found.normal = behind && (flags & uint(DOUBLE_SIDED_FLAG)) != 0u ? -n : n;
        found.metallic = clamp(found.metallic, 0.0, 1.0);
        found.roughness = clamp(found.roughness, 0.0, 1.0);
    }
#endif
    return found;
}
