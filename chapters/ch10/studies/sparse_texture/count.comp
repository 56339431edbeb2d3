// Study sparse-texture: a work group for each tile counts the texels that have memory, and those that are wrong.

#include "fetch.glsl"

layout(local_size_x = TILE) in;

layout(BIND(0, 2, 2), std430) writeonly buffer Counts_ { uvec2 counts[]; };

shared uvec2 columns[TILE];

void main() {
    int column = int(gl_LocalInvocationIndex);
    uint tile = gl_WorkGroupID.x;
    ivec2 corner = ivec2(tile % uint(ACROSS), tile / uint(ACROSS)) * TILE;
    uvec2 found = uvec2(0u);
    for (int row = 0; row < TILE; ++row) {
        ivec2 within = ivec2(column, row);
        uint value;
        if (fetch(corner + within, value)) {
            found += uvec2(1u, value == pattern(tiles[tile].y, within) ? 0u : 1u);
        }
    }
    columns[column] = found;
    barrier();
    if (column == 0) {
        for (int i = 1; i < TILE; ++i) {
            found += columns[i];
        }
        counts[tile] = found;
    }
}
