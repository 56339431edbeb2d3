// Hit trace(Ray, mask) and bool occluded(Ray, mask), by the way that the defines choose: a ray pipeline, ray queries, or our
// own hierarchy.

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
