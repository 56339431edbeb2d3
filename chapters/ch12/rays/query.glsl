// Rays by ray queries: a loop over what the traversal finds, in a compute shader.

#include "rays/world.glsl"

#ifdef NON_OPAQUE
const uint RAY_FLAGS = gl_RayFlagsNoneEXT;
#else
const uint RAY_FLAGS = gl_RayFlagsOpaqueEXT;
#endif

// The second argument of the functions of a query is a constant: false for a candidate, true for what is confirmed.
#define HIT_OF(query, confirmed) \
    Hit(rayQueryGetIntersectionTEXT(query, confirmed), \
        uint(rayQueryGetIntersectionInstanceCustomIndexEXT(query, confirmed)), \
        primitive_of( \
            uint(rayQueryGetIntersectionInstanceCustomIndexEXT(query, confirmed)), \
            uint(rayQueryGetIntersectionPrimitiveIndexEXT(query, confirmed))), \
        rayQueryGetIntersectionBarycentricsEXT(query, confirmed), \
        rayQueryGetIntersectionFrontFaceEXT(query, confirmed) ? 0u : HIT_BACK)

#ifdef NON_OPAQUE
#define PROCEED(query) \
    while (rayQueryProceedEXT(query)) { \
        if (accept(HIT_OF(query, false))) rayQueryConfirmIntersectionEXT(query); \
    }
#else
#define PROCEED(query) while (rayQueryProceedEXT(query)) {}
#endif

Hit trace(Ray ray, uint mask, uint sides) {
    rayQueryEXT query;
    rayQueryInitializeEXT(
        query, ray_world, RAY_FLAGS | sides, mask, ray.origin, ray.t_min, ray.direction, ray.t_max);
    PROCEED(query)
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionNoneEXT) {
        return Hit(ray.t_max, NO_HIT, NO_HIT, vec2(0.0), 0u);
    }
    return HIT_OF(query, true);
}

bool occluded(Ray ray, uint mask, uint sides) {
    rayQueryEXT query;
    rayQueryInitializeEXT(
        query, ray_world, RAY_FLAGS | sides | gl_RayFlagsTerminateOnFirstHitEXT, mask, ray.origin, ray.t_min,
        ray.direction, ray.t_max);
    PROCEED(query)
    return rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT;
}
