// Study sparse-texture: writes the pages that tiles got in this frame, through the image's own addresses or into the pool.

#define POOL writeonly
#include "texture.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

#if SPARSE
layout(BIND(0, 1, 1), r32ui) uniform writeonly uimage2D image;
#endif

struct Fill {
    uint tile, page, content, unused;
};
layout(BIND(0, 2, 2), std430) readonly buffer Fills_ { Fill fills[]; };

void main() {
    ivec2 within = ivec2(gl_GlobalInvocationID.xy);
    Fill fill = fills[gl_GlobalInvocationID.z];
    uint value = pattern(fill.content, within);
#if SPARSE
    ivec2 tile = ivec2(fill.tile % uint(ACROSS), fill.tile / uint(ACROSS));
    imageStore(image, tile * TILE + within, uvec4(value));
#else
    pool[(int(fill.page) * TILE + within.y) * TILE + within.x] = value;
#endif
}
