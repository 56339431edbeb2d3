// Whether a ray stops at a surface that is not opaque. Every way of tracing asks this function.
//
// A masked surface is there where its alpha reaches the cutoff. A blended surface stops the share alpha of all rays: a
// hash of pixel, instance and triangle decides, so the answer depends on neither the order of candidates nor the way. Each
// jitter of the projection has hashes of its own, which a history averages, and so has each ray of the path tracer
// (paths/ray_seed.glsl).

#ifdef NON_OPAQUE
#include "rays/surface.glsl"
#include "palette.glsl"
#ifdef PATHS
#include "paths/ray_seed.glsl"
#endif

#ifdef RAYS_PIPELINE
#define INVOCATION gl_LaunchIDEXT.xy
#else
#define INVOCATION gl_GlobalInvocationID.xy
#endif
#ifndef RAY_ID  // where invocations are no pixels, what includes this says which one it is
#ifdef TILED
#include "rays/tile.glsl"
#define RAY_ID (INVOCATION + tile.first.xy)
#else
#define RAY_ID INVOCATION
#endif
#endif

bool accept(Hit hit) {
    Instance instance = instance_of(hit.instance);
    Material material = materials[instance.material];
    uint flags = uint(material.uv_rows[1].w);
    if ((flags & uint(MASKED_FLAG | BLENDED_FLAG)) == 0u) {
        return true;
    }
    float alpha = alpha_of(hit, instance, material);
    if ((flags & uint(MASKED_FLAG)) != 0u) {
        return alpha >= material.emissive.a;
    }
#ifdef PATHS
    uint seed = path_ray_seed();
    uvec2 pixel = RAY_ID + path.crop.xy;
#else
    uvec2 pixel = RAY_ID;
    uint seed = scrambled(floatBitsToUint(frame.view_from_clip[3].x)) ^ floatBitsToUint(frame.view_from_clip[3].y);
#endif
    uint drawn = scrambled(scrambled(scrambled((pixel.x | pixel.y << 16) ^ seed) ^ hit.instance) ^ hit.primitive);
    return alpha > float(drawn >> 8) * (1.0 / 16777216.0);
}
#endif
