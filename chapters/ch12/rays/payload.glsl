// What the shaders of a hit see of the ray that they belong to.

#include "rays/world.glsl"

#ifdef RAYS_ATTRIBUTES  // shaders of hits: what the intersection test found
hitAttributeEXT vec2 ray_at;

Hit found() {
    uint instance = uint(gl_InstanceCustomIndexEXT);
    uint back = gl_HitKindEXT == gl_HitKindBackFacingTriangleEXT ? HIT_BACK : 0u;
    return Hit(gl_HitTEXT, instance, primitive_of(instance, uint(gl_PrimitiveID)), ray_at, back);
}
#endif
