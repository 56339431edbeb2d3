// Study callables: the nearest hit. Its material is a number.

#extension GL_EXT_ray_tracing : require

#include "materials.glsl"

layout(BIND(0, 3, 0), std430) readonly buffer Normals_ { vec4 normals[]; };  // of triangles; w: the material

layout(location = 0) rayPayloadInEXT vec4 found;
#ifndef INLINE
layout(location = 0) callableDataEXT Point at;
#endif

const vec3 TO_LIGHT = vec3(0.2857, 0.8571, 0.4286);

void main() {
    vec4 normal = normals[gl_PrimitiveID];
    uint material = uint(normal.w);
    vec3 position = gl_WorldRayOriginEXT + gl_HitTEXT * gl_WorldRayDirectionEXT;
#ifdef INLINE
    Point at = Point(position, normal.xyz, vec3(0.0));
    switch (material) {
    case 0u: at.color = checks(at); break;
    case 1u: at.color = rings(at); break;
    case 2u: at.color = stripes(at); break;
    default: at.color = spots(at); break;
    }
#else
    at = Point(position, normal.xyz, vec3(0.0));
    executeCallableEXT(material, 0);
#endif
    found = vec4(at.color * (0.25 + 0.75 * max(dot(normal.xyz, TO_LIGHT), 0.0)), gl_HitTEXT);
}
