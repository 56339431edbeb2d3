// A number that differs from ray to ray, by which blended surfaces stop one ray and let another one through.
//
// The shader of a possible hit knows nothing of the path that its ray belongs to, but it does know the ray. Where it begins and
// leads is random, and so is its hash. Rays through the middle of a pixel are equal in all paths: so t_min, which is next to 0,
// tells the number of the path in its frame.

#include "palette.glsl"
#include "paths/frame.glsl"

const uint FIRST_PATH = 0x0DA24260u;  // the bits of 1e-30: t_min of the first path in a frame, and the next floats of others

float path_begin(uint number_in_frame) { return uintBitsToFloat(FIRST_PATH + number_in_frame); }

uint seed_of_ray(vec3 origin, vec3 direction, float t_min) {
    uvec3 from = floatBitsToUint(origin), to = floatBitsToUint(direction);
    uint number = path.samples.x + (floatBitsToUint(t_min) - FIRST_PATH);
    uint hash = scrambled(number + scrambled(path.samples.w));
    hash = scrambled(scrambled(scrambled(hash ^ from.x) ^ from.y) ^ from.z);
    return scrambled(scrambled(scrambled(hash ^ to.x) ^ to.y) ^ to.z);
}

#ifdef RAYS_ATTRIBUTES  // the shader of a hit
uint path_ray_seed() { return seed_of_ray(gl_WorldRayOriginEXT, gl_WorldRayDirectionEXT, gl_RayTminEXT); }
#else
uint path_seed = 0u;
uint path_ray_seed() { return path_seed; }
#endif
