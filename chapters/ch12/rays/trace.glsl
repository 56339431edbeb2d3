// Hit trace(Ray, mask, sides) and bool occluded(Ray, mask, sides), by the way that the defines choose: a ray pipeline, ray
// queries, or our own hierarchy. `sides` are SKIP_BACKS, SKIP_FRONTS, or 0 for both sides of all surfaces.

#include "rays/ray.glsl"
#ifdef RAYS_PIPELINE
#include "rays/pipeline.glsl"
#else
#ifdef NON_OPAQUE
#include "rays/accept.glsl"
#endif
#ifdef RAYS_QUERY
#include "rays/query.glsl"
#else
#include "rays/bvh/traverse.glsl"
#endif
#endif
