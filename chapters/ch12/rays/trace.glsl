// Hit trace(Ray, mask) and bool occluded(Ray, mask), by the way that the pass was built for.

#if defined(RAYS_PIPELINE)
#include "rays/pipeline.glsl"
#elif defined(RAYS_QUERY)
#include "rays/query.glsl"
#else
#define BVH_NODES_AT BIND(3, 0, 5)
#define BVH_TRIANGLES_AT BIND(3, 1, 6)
#define BVH_INSTANCES_AT BIND(3, 2, 7)
#include "rays/bvh/traverse.glsl"
#endif
