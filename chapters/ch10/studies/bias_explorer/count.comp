// Study bias-explorer: a work group for each cell and an invocation for each row of points, which counts what is wrong.

#include "compare.glsl"

layout(local_size_x = SAMPLES) in;

layout(BIND(0, 2, 2), std430) writeonly buffer Counts_ { uvec2 counts[]; };

shared uvec2 rows[SAMPLES];

void main() {
    int row = int(gl_LocalInvocationIndex), cell = int(gl_WorkGroupID.x);
    const float spacing = float(SIDE) / float(SAMPLES);
    uvec2 found = uvec2(0u);
    for (int i = 0; i < SAMPLES; ++i) {
        vec2 at = (vec2(i, row) + 0.5) * spacing;
        float lit = lit_part(cell % TILTS, cell / TILTS, at);
        if (is_bare(at) && lit < 1.0) {
            found.x += 1u;
        }
        if (is_below(at) && lit > 0.0) {
            found.y = uint(row) + 1u;
        }
    }
    rows[row] = found;
    barrier();
    if (row == 0) {
        for (int i = 1; i < SAMPLES; ++i) {
            found = uvec2(found.x + rows[i].x, max(found.y, rows[i].y));
        }
        counts[cell] = found;
    }
}
