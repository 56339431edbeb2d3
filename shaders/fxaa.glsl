// Anti-aliasing of a finished picture by its contrast alone: the decisions for one pixel, from lumas around it.
//
// Idea: Lottes 2009, "FXAA" (NVIDIA white paper), and the quality version of FXAA 3.11: find pixels with contrast, find the
// direction of the edge and its ends, and shift the pixel across the edge by what a straight edge would cover.
//
// `around` has the lumas of 3x3 pixels, row by row. All sums add mirrored pixels first, so that a mirrored or transposed
// picture gives the same bits.

// Luma: the weighted sum of the codes of a picture, which is about as uniform as what is seen (ITU-R BT.709).
float luma(vec3 code) {
    return dot(code, vec3(0.2126, 0.7152, 0.0722));
}

// The contrast of a pixel and its four neighbours; 0 where it is below `least`, or below a share of the brightest luma.
float fxaa_contrast(float around[9], float share, float least) {
    float across = max(max(around[1], around[7]), max(around[3], around[5]));
    float lowest = min(min(around[1], around[7]), min(around[3], around[5]));
    across = max(across, around[4]);
    float range = across - min(lowest, around[4]);
    return range < max(least, share * across) ? 0.0 : range;
}

// How strongly luma bends across a horizontal edge (x), and across a vertical one (y).
vec2 fxaa_bends(float around[9]) {
    vec3 down = abs(vec3(
        (around[0] + around[6]) - 2.0 * around[3],
        (around[1] + around[7]) - 2.0 * around[4],
        (around[2] + around[8]) - 2.0 * around[5]
    ));
    vec3 right = abs(vec3(
        (around[0] + around[2]) - 2.0 * around[1],
        (around[3] + around[5]) - 2.0 * around[4],
        (around[6] + around[8]) - 2.0 * around[7]
    ));
    return vec2((down.x + down.z) + 2.0 * down.y, (right.x + right.z) + 2.0 * right.y);
}

// The shift in pixels for details below a pixel: large where a pixel differs from all around it.
float fxaa_detail(float around[9], float contrast, float strength) {
    float cross = (around[1] + around[7]) + (around[3] + around[5]);
    float corners = (around[0] + around[8]) + (around[2] + around[6]);
    float part = clamp(abs((2.0 * cross + corners) / 12.0 - around[4]) / contrast, 0.0, 1.0);
    part *= part * (3.0 - 2.0 * part);
    return strength * part * part;
}

// The shift in pixels that a straight edge asks for. `ends` are the pixels to walk along the edge, both ways, until luma
// changes (1 or more); `bent` says whether at that end luma goes away from this pixel's, so that the edge ends there on
// this pixel's side. Between its ends a straight edge goes from half a pixel on one side to half a pixel on the other.
float fxaa_shift(vec2 ends, bvec2 bent) {
    float span = ends.x + ends.y - 1.0;
    bool nearer = ends.x < ends.y ? bent.x : bent.y;
    return nearer ? max(0.5 - (min(ends.x, ends.y) - 0.5) / span, 0.0) : 0.0;
}
