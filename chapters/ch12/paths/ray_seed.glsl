// A number that differs from ray to ray, by which blended surfaces stop one ray and let another one through.
//
// The shader of a possible hit knows nothing of the path that its ray belongs to, but it does know the ray. Where it begins and
// leads is random, and so is its hash. The number of the path is in the block of the frame. If all rays of the eye go through the
// middle of a pixel, those of one frame are equal and meet the same layers; the mean of frames is right all the same.

#include "paths/frame.glsl"

uint seed_of_ray(vec3 origin, vec3 direction) {
    uvec3 from = floatBitsToUint(origin), to = floatBitsToUint(direction);
    uint hash = scrambled(path.samples.x + scrambled(path.samples.w));
    hash = scrambled(scrambled(scrambled(hash ^ from.x) ^ from.y) ^ from.z);
    return scrambled(scrambled(scrambled(hash ^ to.x) ^ to.y) ^ to.z);
}

#ifdef RAYS_ATTRIBUTES  // the shader of a hit
uint path_ray_seed() { return seed_of_ray(gl_WorldRayOriginEXT, gl_WorldRayDirectionEXT); }
#else
uint path_seed = 0u;
uint path_ray_seed() { return path_seed; }
#endif
