// Study procedural-spheres: the ray of a pixel, and the colour of the sphere that it meets.

#include "studies/eye.glsl"
#include "sphere.glsl"
#include "palette.glsl"

const vec3 TO_LIGHT = vec3(0.4558, 0.7975, 0.3960);

#ifdef RAYS_PIPELINE
layout(BIND(0, 4, 0)) uniform accelerationStructureEXT world;
layout(location = 0) rayPayloadEXT Found found;

Found nearest(vec3 origin, vec3 direction) {
    traceRayEXT(world, gl_RayFlagsNoneEXT, 0xFFu, 0u, 0u, 0u, origin, 0.0, direction, 1e30, 0);
    return found;
}
#else
Found nearest(vec3 origin, vec3 direction) {
    Found found = Found(-1.0, 0u, 0u);
    for (uint i = 0u; i < eye.size.w; ++i) {
        float t;
        uint kind;
        if (hits_sphere(origin, direction, 0.0, spheres[i], t, kind) && (found.t < 0.0 || t < found.t)) {
            found = Found(t, i, kind);
        }
    }
    atomicAdd(counts[0], eye.size.w);
    return found;
}
#endif

vec3 color_of(uint sphere) {
    uint hash = scrambled(sphere);
    vec3 color = vec3(hash & 255u, hash >> 8 & 255u, hash >> 16 & 255u) / 255.0;
    return sphere == 0u ? vec3(0.45) : mix(vec3(0.2), color, 0.8);
}

void run(uvec3 id) {
    if (!in_picture(id.xy)) {
        return;
    }
    CameraRay ray = ray_of(id.xy);
    Found hit = nearest(ray.origin, ray.direction);
    if (hit.t < 0.0) {
        found_at(id.xy, vec4(0.35, 0.5, 0.8, -1.0), uvec4(0u));
        return;
    }
    vec4 sphere = spheres[hit.sphere];
    vec3 normal = (ray.origin + hit.t * ray.direction - sphere.xyz) / sphere.w;
    normal = hit.kind == INSIDE ? -normal : normal;
    float light = 0.15 + 0.85 * max(dot(normal, TO_LIGHT), 0.0);
    found_at(id.xy, vec4(light * color_of(hit.sphere), hit.t), uvec4(hit.sphere, hit.kind, 1u, 0u));
}
