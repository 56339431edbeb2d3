// Study sparse-texture: a fetch of one texel with the answer whether it has memory.

#define POOL readonly
#include "texture.glsl"

#if SPARSE
layout(BIND(0, 1, 1)) uniform usampler2D image;
#endif

// Without memory `value` means nothing: a device may return zeros there, or what was written last.
bool fetch(ivec2 at, out uint value) {
#if SPARSE
    uvec4 texel = uvec4(0u);
    int code = sparseTexelFetchARB(image, at, 0, texel);
    value = texel.r;
    return sparseTexelsResidentARB(code);
#else
    ivec2 within = at % TILE;
    uint page = tiles[(at.y / TILE) * ACROSS + at.x / TILE].x;
    value = 0u;
    if (page == 0xffffffffu) {
        return false;
    }
    value = pool[(int(page) * TILE + within.y) * TILE + within.x];
    return true;
#endif
}
