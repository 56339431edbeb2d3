// What shaders of the scene see of fog, all of it in set 0: the medium and the grid of this frame, and the store.
//
// The store is one buffer: ranks of blue noise, then a record for each froxel, then the fog of each half-resolution pixel
// (model.py: Places). A record has all that a surface in its froxel needs, so a lookup reads
// one place for each of four columns.

#ifdef FOG
struct FogBox {
    vec4 center;     // xyz: relative to the scene's origin, w: extinction per metre
    vec4 half_size;  // xyz
    vec4 albedo;     // rgb
};

layout(BIND(0, 13, 13), std140) uniform Fog_ {
    vec4 wind;      // xyz: shift of the noise in periods
    vec4 history;   // x: share of the current frame; y: amplitude of the dither, in parts of the code of sRGB
    uvec4 frame;    // x: number for blue noise, y: 1 if nothing has changed since the frame before, z: 1 if fog is in view,
                    // w: and if it was in the frame before
    uvec4 places;   // in the store: y: the first word of froxels, z: of half-resolution pixels; w: pixels in their rows
    vec4 range;     // x: near, y: log2(far / near), z: far, metres; w: the mean cosine of the phase function
    uvec4 size;     // froxels: x, y, z; w: boxes
    vec4 constant;  // rgb: albedo, a: extinction per metre
    vec4 height;    // rgb: albedo, a: extinction per metre up to the base
    vec4 shape;     // x: the base, y: falloff per metre; z: contrast of the noise, w: its periods per metre
    vec4 bounds;    // xyz: half the size of the scene, where the medium ends for the sun's light;
                    // w: the tolerance of half resolution
    vec4 ambient;   // rgb: mean radiance of the environment, nits
    FogBox boxes[FOG_BOXES];
} fog;

#ifdef FOG_WRITTEN
layout(BIND(0, 14, 15), std430) buffer Fog_store_ { uvec4 fog_store[]; };
#else
layout(BIND(0, 14, 15), std430) readonly buffer Fog_store_ { uvec4 fog_store[]; };
#endif
#endif
