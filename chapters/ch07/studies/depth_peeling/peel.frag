// One layer of each pixel: the nearest blended surface that lies in front of everything solid and, but for the first
// layer, behind the layer of the pass before. The surface is shaded by the chapter's own shader.

#define main shade
#include "shading/forward.frag"
#undef main

layout(BIND(3, 0, 14)) uniform sampler2D solid_depth;
#ifdef BEHIND
layout(BIND(3, 1, 15)) uniform sampler2D last_depth;
#endif

void main() {
    shade();  // first: neighbours of a discarded fragment have no derivatives
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    // Reversed depth is greater at what is nearer.
    bool hidden = gl_FragCoord.z < texelFetch(solid_depth, pixel, 0).r;
#ifdef BEHIND
    hidden = hidden || gl_FragCoord.z >= texelFetch(last_depth, pixel, 0).r;
#endif
    if (hidden) {
        discard;
    }
}
