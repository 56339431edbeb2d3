// Study procedural-spheres: no sphere.

#extension GL_EXT_ray_tracing : require

#include "sphere.glsl"

layout(location = 0) rayPayloadInEXT Found found;

void main() { found = Found(-1.0, 0u, 0u); }
