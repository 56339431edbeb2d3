// The depth pyramid in its buffer. The including shader declares the buffer, with an array `float pyramid[]`.
//
// Level k, from 1 on, has ceil(width / 2^k) x ceil(height / 2^k) texels, row by row, the levels one behind the other;
// the last level is one texel. Texel (x, y) is the minimum of the depth, and so the farthest depth (reversed Z), of
// those pixels of [x * 2^k, (x + 1) * 2^k) x [y * 2^k, (y + 1) * 2^k) that are inside the picture. Sizes are rounded
// up, so that every pixel is below exactly one texel of each level, whatever the size of the picture.
// culling/pyramid.py has the same layout.

#include "bounds.glsl"

// `findMSB` gets no 0; see `occlusion_level`.
uint pyramid_levels(uvec2 picture) { return uint(findMSB(max(max(picture.x, picture.y) - 1u, 1u))) + 1u; }

uvec2 pyramid_size(uint level, uvec2 picture) { return (picture + ((1u << level) - 1u)) >> level; }

// The first word of a level: the texels of the levels before it.
uint pyramid_offset(uint level, uvec2 picture) {
    uint words = 0u;
    for (uint before = 1u; before < level; ++before) {
        uvec2 size = pyramid_size(before, picture);
        words += size.x * size.y;
    }
    return words;
}

// The first word of level 0, the picture itself, behind the last level: things of a few pixels are tested with it.
uint picture_offset(uvec2 picture) { return pyramid_offset(pyramid_levels(picture) + 1u, picture); }

float pyramid_texel(uint level, uvec2 at, uvec2 picture) {
    return pyramid[pyramid_offset(level, picture) + at.y * pyramid_size(level, picture).x + at.x];
}

// A depth at least as far as every depth of pixels first..last, inclusive: the minimum of the at most 2x2 texels in
// which they lie at `occlusion_level`. Both pixels have to be inside the picture.
float farthest_depth(uvec2 first, uvec2 last, uvec2 picture) {
    uint level = occlusion_level(first, last);
    uint start = pyramid_offset(level, picture), width = pyramid_size(level, picture).x;
    uvec2 low = first >> level, high = last >> level;
    uint above = start + low.y * width, below = start + high.y * width;
    return min(
        min(pyramid[above + low.x], pyramid[above + high.x]), min(pyramid[below + low.x], pyramid[below + high.x])
    );
}
