// Study procedural-spheres: the nearest hit that was reported.

#extension GL_EXT_ray_tracing : require

#include "sphere.glsl"

layout(location = 0) rayPayloadInEXT Found found;

void main() { found = Found(gl_HitTEXT, uint(gl_PrimitiveID), gl_HitKindEXT); }
