// Study shading-rates: two triangles for each cell; all of their vertices have the same rate, though only the first decides.

#extension GL_EXT_fragment_shading_rate : require

#include "cells.glsl"

layout(location = 0) flat out uint out_cell;

const uint CORNERS[] = uint[](0u, 1u, 2u, 2u, 1u, 3u);

void main() {
    out_cell = push.draw.x + uint(VERTEX_ID) / 6u;
    gl_Position = corner_of(out_cell, CORNERS[VERTEX_ID % 6]);
#if BY_PRIMITIVE
    gl_PrimitiveShadingRateEXT = rate_of(out_cell);
#endif
}
