// The nearest hit of a ray: its payload is what was found.

#define RAYS_ATTRIBUTES 1
#include "rays/payload.glsl"

layout(location = 0) rayPayloadInEXT Hit ray_hit;

void main() { ray_hit = found(); }
