// Study far-march: the fog of each pixel, from the grid up to its far end, and from there on by a march.

#include "air.glsl"
#include "plain.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(BIND(0, 1, 1), std430) readonly buffer Grid_ { vec4 grid[]; };
layout(BIND(0, 2, 2), std430) writeonly buffer Fog_ { vec4 fog[]; };

// Between the four columns around uv; all of a slice, `part` 0 for where it begins, 1 for what it adds.
vec4 between(vec2 uv, uint slice, uint part) {
    vec2 place = clamp(uv * air.size.xy - 0.5, vec2(0.0), air.size.xy - 1.0);
    uvec2 first = uvec2(place), last = uvec2(air.size.xy) - 1u;
    vec2 weight = place - vec2(first);
    vec4 sum = vec4(0.0);
    for (uint i = 0u; i < 4u; ++i) {
        uvec2 corner = uvec2(i & 1u, i >> 1);
        vec2 weights = mix(1.0 - weight, weight, vec2(corner));
        sum += weights.x * weights.y * grid[record_at(uvec3(min(first + corner, last), slice)) + part];
    }
    return sum;
}

// The far end, too, is the end of the last slice on this ray. A mean of the ends of four columns would be a seam: their
// rays are as long as their own places in the picture say.
vec4 in_grid(vec2 uv, float depth, float stretch) {
    uint count = uint(air.size.z);
    depth = min(depth, air.range.z);
    uint slice = min(uint(max(slice_coordinate(depth, air.range.x, air.range.y), 0.0) * air.size.z), count - 1u);
    vec4 here = between(uv, slice, 1u);
    float metres = max(depth - slice_begin(slice, count, air.range.x, air.range.y), 0.0) * stretch;
    return through_segment(between(uv, slice, 0u), here.rgb, here.a, metres);
}

vec4 marched(vec4 fog, Ray ray, float depth) {
    uint steps = uint(air.size.w);
    float octaves = log2(depth / air.range.z), begin = air.range.z;
    for (uint k = 1u; k <= steps; ++k) {
        float end = k == steps ? depth : air.range.z * exp2(octaves * float(k) / float(steps));
        float y0 = ray.start.y + ray.way.y * begin, y1 = ray.start.y + ray.way.y * end;
        float extinction = mean_extinction(y0, y1);
        vec3 light = extinction * light_at(0.5 * (y0 + y1), ray.leaving);
        fog = through_segment(fog, light, extinction, max(end - begin, 0.0) * ray.stretch);
        begin = end;
    }
    return fog;
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, uvec2(air.target.xy)))) {
        return;
    }
    vec2 uv = (vec2(pixel) + 0.5) / air.target.xy;
    Ray ray = ray_through(uv);
    float depth = seen_along(ray).depth;
    vec4 found = in_grid(uv, depth, ray.stretch);
    if (air.sky.w > 0.0 && depth > air.range.z) {
        found = marched(found, ray, depth);
    }
    fog[pixel.y * uint(air.target.x) + pixel.x] = found;
}
