// A ray of `occluded` that hits nothing: the way is open.

#include "rays/payload.glsl"

layout(location = 1) rayPayloadInEXT uint ray_blocked;

void main() { ray_blocked = 0u; }
