// Rays by a ray pipeline, in the ray generation shader. Its groups are those of rays/groups.py: two miss shaders, one group
// of hits.

#include "rays/payload.glsl"

layout(location = 0) rayPayloadEXT Hit ray_hit;
layout(location = 1) rayPayloadEXT uint ray_blocked;

#ifdef NON_OPAQUE  // else no instance has an any-hit shader to be called, and the driver need not look
const uint RAY_FLAGS = gl_RayFlagsNoneEXT;
#else
const uint RAY_FLAGS = gl_RayFlagsOpaqueEXT;
#endif

Hit trace(Ray ray, uint mask, uint sides) {
    traceRayEXT(ray_world, RAY_FLAGS | sides, mask, 0u, 0u, 0u, ray.origin, ray.t_min, ray.direction, ray.t_max, 0);
    return ray_hit;
}

bool occluded(Ray ray, uint mask, uint sides) {
    // The miss shader alone writes: any hit ends the ray, and no shader runs for it.
    ray_blocked = 1u;
    traceRayEXT(
        ray_world, RAY_FLAGS | sides | gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipClosestHitShaderEXT, mask,
        0u, 0u, 1u, ray.origin, ray.t_min, ray.direction, ray.t_max, 1);
    return ray_blocked != 0u;
}
