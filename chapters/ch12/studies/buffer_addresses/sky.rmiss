// Study buffer-addresses: nothing is hit, and nothing fetched.

#extension GL_EXT_ray_tracing : require

#include "payload.glsl"

layout(location = 0) rayPayloadInEXT Fetched found;

void main() { found = Fetched(vec4(0.05, 0.06, 0.09, -1.0), uvec4(0xFFFFFFFFu, 0u, 0u, 0u)); }
