// Material resolve: the surface of each pixel, found from the number of its triangle and stored as the G-buffer pass
// stores it. An invocation fetches three vertices, transforms them as the vertex shader did, and interpolates by itself.
//
// One pipeline serves all solid materials: it has the code that any of them needs, and a material's flags say what it
// needs. A dispatch treats the pixels of one page of geometry and of one set of textures, and leaves out the others.

layout(local_size_x = 8, local_size_y = 8) in;

#define COMPUTED
#include "scene/scene.glsl"
#include "scene/vertices.glsl"
#include "shading/material.glsl"
#include "finite.glsl"
#include "transform.glsl"
#include "barycentrics.glsl"
#include "cotangent.glsl"

struct Part {
    uvec4 which;  // the page of geometry and the set of textures of the pixels that this dispatch treats; samples
};
PUSH(Part, part)

#ifdef TEXTURED
#include "gradients.glsl"
#endif
#include "shading/gbuffer.glsl"

layout(BIND(3, 0, 16)) uniform usampler2D visibility;
layout(BIND(3, 1, 0), COLOR_FORMAT) uniform writeonly image2D gbuffer_base_color;
#ifdef NORMAL_OCTAHEDRAL
layout(BIND(3, 2, 1), NORMAL_FORMAT) uniform writeonly uimage2D gbuffer_normal;
#else
layout(BIND(3, 2, 1), NORMAL_FORMAT) uniform writeonly image2D gbuffer_normal;
#endif
layout(BIND(3, 3, 2), MATERIAL_FORMAT) uniform writeonly image2D gbuffer_material;
#ifdef EMISSION
layout(BIND(3, 4, 3), EMISSION_FORMAT) uniform writeonly image2D gbuffer_emissive;
#endif

struct Vertex {
    vec3 world;
    vec4 clip;
};

Vertex vertex_of(Instance instance, Mesh mesh, uint number) {
    vec3 world = transform_point(instance.world_from_object, fetch3(mesh.streams[0].x, number));
    return Vertex(world, clip_position(frame.clip_from_view, frame.view_from_world, world));
}

// Weighted sums of an attribute of three vertices. The third vertex is written as the rest, so that an attribute that is
// equal at all three comes out with the same bits.
vec2 mixed2(uint stream, uvec3 v, vec3 at) {
    vec2 last = fetch2(stream, v.z);
    return last + (fetch2(stream, v.x) - last) * at.x + (fetch2(stream, v.y) - last) * at.y;
}

vec2 changed2(uint stream, uvec3 v, vec3 change) {
    return fetch2(stream, v.x) * change.x + fetch2(stream, v.y) * change.y + fetch2(stream, v.z) * change.z;
}

vec3 mixed3(uint stream, uvec3 v, vec3 at) {
    return fetch3(stream, v.x) * at.x + fetch3(stream, v.y) * at.y + fetch3(stream, v.z) * at.z;
}

vec4 mixed4(uint stream, uvec3 v, vec3 at) {
    return fetch4(stream, v.x) * at.x + fetch4(stream, v.y) * at.y + fetch4(stream, v.z) * at.z;
}

#ifdef TEXTURED
const vec2 NONE[2] = vec2[2](vec2(0.0), vec2(0.0));
vec2 uv[2] = NONE;  // both sets at this pixel, and their changes to the next pixel along x and y
vec2 uv_x[2] = NONE;
vec2 uv_y[2] = NONE;

// A role's uv, or a change of it, in its image; see image_uv.
vec2 turned_uv(Material material, int role, vec2 change) {
    return vec2(dot(material.uv_rows[2 * role].xy, change), dot(material.uv_rows[2 * role + 1].xy, change));
}

vec4 resolved_map(Material material, int role, uint map, uint arrays) {
    int own = material.uv_rows[2 * role].w > 0.5 ? 1 : 0;
    vec2 at = image_uv(material, role, uv[0], uv[1]);
    vec2 dx = turned_uv(material, role, uv_x[own]), dy = turned_uv(material, role, uv_y[own]);
#ifdef STEADY_UV  // as in taa/unjitter.glsl, by the changes to the next pixels
    vec2 jitter = 0.5 * frame.jitter * frame.size.xy;
    at += dx * jitter.x + dy * jitter.y;
#endif
    if (dx == vec2(0.0) && dy == vec2(0.0)) {
        return sample_finest(map, arrays, at);
    }
    return sample_between(map, arrays, at, dx, dy);
}
#endif

// Finds the surface of a pixel; returns false if another dispatch does.
bool surface_of(ivec2 pixel) {
    uvec2 ids = texelFetch(visibility, pixel, 0).xy;
    if (ids.x == 0u) {  // the background: every dispatch stores the same
        store_unlit(vec3(0.0));
        out_base_color.a = 0.0;
        return true;
    }
    Instance instance = instance_of(ids.x - 1u);
    Mesh mesh = meshes[instance.mesh];
    Material material = materials[instance.material];
    if (mesh.streams[1].w != part.which.x || material.maps[1].y != part.which.y) {
        return false;
    }
    uint first = mesh.streams[1].z + (ids.y & ~BACK);
    uvec3 v = uvec3(words[first], words[first + 1u], words[first + 2u]);
    Vertex a = vertex_of(instance, mesh, v.x), b = vertex_of(instance, mesh, v.y), c = vertex_of(instance, mesh, v.z);
    vec2 size = 2.0 * frame.size.zw;
    Barycentrics here = barycentrics_of(a.clip, b.clip, c.clip, (vec2(pixel) + 0.5) * size - 1.0, size);
    uint flags = uint(material.uv_rows[1].w);

#ifdef TEXTURED
    uv[0] = mixed2(mesh.streams[0].w, v, here.at);
    uv_x[0] = changed2(mesh.streams[0].w, v, here.dx);
    uv_y[0] = changed2(mesh.streams[0].w, v, here.dy);
#ifdef UV1
    uv[1] = mixed2(mesh.streams[1].x, v, here.at);
    uv_x[1] = changed2(mesh.streams[1].x, v, here.dx);
    uv_y[1] = changed2(mesh.streams[1].x, v, here.dy);
#endif
#endif

    vec4 base = material.base_color;
#ifdef VERTEX_COLOR
    base *= mixed4(mesh.streams[1].y, v, here.at);
#endif
#ifdef BASE_COLOR_MAP
    if ((flags & 1u) != 0u) {
        base *= resolved_map(material, 0, base_color_map);
    }
#endif
#ifdef SHADED
    if ((flags & uint(UNLIT_FLAG)) == 0u) {
        float metallic = material.factors.x, roughness = material.factors.y, occlusion = 1.0;
#ifdef METALLIC_ROUGHNESS_MAP
        if ((flags & 2u) != 0u) {
            vec4 factors = resolved_map(material, 1, metallic_roughness_map);
            roughness *= factors.g;
            metallic *= factors.b;
        }
#endif
#ifdef OCCLUSION_MAP
        if ((flags & 8u) != 0u) {
            occlusion += material.factors.w * (resolved_map(material, 3, occlusion_map).r - 1.0);
        }
#endif
        vec3 emissive = material.emissive.rgb;
#ifdef EMISSIVE_MAP
        if ((flags & 16u) != 0u) {
            emissive *= resolved_map(material, 4, emissive_map).rgb;
        }
#endif

        vec3 n = transform_vector(instance.normal_from_object, mixed3(mesh.streams[0].y, v, here.at));
        float n2 = dot(n, n);
        vec3 toward = frame.world_from_view[2].xyz;
        if (frame.orthographic == 0u) {
            toward = frame.eye.xyz - (a.world * here.at.x + b.world * here.at.y + c.world * here.at.z);
        }
        n = n2 > 0.0 ? n * inversesqrt(n2) : toward * inversesqrt(max(dot(toward, toward), 1e-30));
#ifdef NORMAL_MAP
        if ((flags & 4u) != 0u) {
#ifdef TANGENTS_DERIVED
            int own = material.uv_rows[4].w > 0.5 ? 1 : 0;
            vec3 dp_x = a.world * here.dx.x + b.world * here.dx.y + c.world * here.dx.z;
            vec3 dp_y = a.world * here.dy.x + b.world * here.dy.y + c.world * here.dy.z;
            Frame3 derived = cotangent_frame(n, dp_x, dp_y, uv_x[own], uv_y[own]);
            vec3 t = derived.tangent, bitangent = -derived.bitangent;  // glTF's green points up, and its v down
#else
            vec4 tangent = mixed4(mesh.streams[0].z, v, here.at);
            float handedness = (instance.flags & INSTANCE_MIRRORED) != 0u ? -tangent.w : tangent.w;
            vec3 t = transform_vector(instance.world_from_object, tangent.xyz);
            t -= n * dot(n, t);
            float t2 = dot(t, t);
            t *= t2 > 0.0 ? inversesqrt(t2) : 0.0;
            vec3 bitangent = cross(n, t) * handedness;
#endif
            vec3 sampled = resolved_map(material, 2, normal_map).xyz * 2.0 - 1.0;
            sampled.xy *= material.factors.z;
            vec3 mapped = sampled.x * t + sampled.y * bitangent + sampled.z * n;
            float m2 = t == vec3(0.0) ? 0.0 : dot(mapped, mapped);
            n = m2 > 0.0 ? mapped * inversesqrt(m2) : n;
        }
#endif
        n = (flags & uint(DOUBLE_SIDED_FLAG)) != 0u && (ids.y & BACK) != 0u ? -n : n;
        store_surface(
            base.rgb, n, occlusion, clamp(roughness, 0.0, 1.0), clamp(metallic, 0.0, 1.0), emissive * exposure()
        );
        return true;
    }
#endif
    store_unlit(base.rgb);
    return true;
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(gbuffer_material))) || !surface_of(pixel)) {
        return;
    }
    imageStore(gbuffer_base_color, pixel, out_base_color);
#ifdef NORMAL_OCTAHEDRAL
    imageStore(gbuffer_normal, pixel, uvec4(out_normal, 0u, 0u, 0u));
#else
    imageStore(gbuffer_normal, pixel, out_normal);
#endif
    imageStore(gbuffer_material, pixel, out_material);
#ifdef EMISSION
    imageStore(gbuffer_emissive, pixel, out_emission);
#endif
}
