// Study callables: nothing is hit.

#extension GL_EXT_ray_tracing : require

layout(location = 0) rayPayloadInEXT vec4 found;

void main() { found = vec4(0.35, 0.5, 0.8, -1.0); }
