// A ray that hits nothing.

#include "rays/payload.glsl"

layout(location = 0) rayPayloadInEXT Hit ray_hit;

void main() { ray_hit = Hit(gl_RayTmaxEXT, NO_HIT, NO_HIT, vec2(0.0), 0u); }
