// What shaders of the scene see of shadows: the faces, the table, and the pages, all of set 0.
//
// The pages are an image that is loaded from, and no texture: textures of materials and environment use up the 16 samplers
// that every device has, and the filter is our own.

#ifdef SHADOWS
#define SHADOW_BLOCK 11
#include "shadows/block.glsl"
layout(BIND(0, 12, 7), r32f) uniform readonly image2DArray shadow_pages;
#endif
