// The acceleration structure of the scene, at binding RAYS_BINDING of set RAYS_SET, and behind it the map from triangles
// of its structures to triangles of the meshes: for each instance the place where the list of its mesh begins, then the lists.

#include "rays/ray.glsl"

layout(BIND(RAYS_SET, RAYS_BINDING, 0)) uniform accelerationStructureEXT ray_world;
layout(BIND(RAYS_SET, RAYS_BINDING + 1, 0), std430) readonly buffer Ray_order_ { uint ray_order[]; };

uint primitive_of(uint instance, uint triangle) { return ray_order[ray_order[instance] + triangle]; }
