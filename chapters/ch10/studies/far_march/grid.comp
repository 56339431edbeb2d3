// Study far-march: fills a column of froxels and sums it. A record has the fog where its slice begins, and what the slice
// adds per metre.

#include "air.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(BIND(0, 1, 1), std430) writeonly buffer Grid_ { vec4 grid[]; };

void main() {
    uvec2 column = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(column, uvec2(air.size.xy)))) {
        return;
    }
    Ray ray = ray_through((vec2(column) + 0.5) / air.size.xy);
    uint count = uint(air.size.z);
    vec4 before = vec4(0.0, 0.0, 0.0, 1.0);
    for (uint z = 0u; z < count; ++z) {
        float y = ray.start.y + ray.way.y * slice_sample(z, 0.5, count, air.range.x, air.range.y);
        float extinction = extinction_at(y);
        vec4 here = vec4(extinction * light_at(y, ray.leaving), extinction);
        uint at = record_at(uvec3(column, z));
        grid[at] = before;
        grid[at + 1u] = here;
        float end = slice_depth(float(z + 1u) / float(count), air.range.x, air.range.y);
        float metres = (end - slice_begin(z, count, air.range.x, air.range.y)) * ray.stretch;
        before = through_segment(before, here.rgb, here.a, metres);
    }
}
