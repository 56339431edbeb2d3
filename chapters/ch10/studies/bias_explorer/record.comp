// Study bias-explorer: the map of each plane, the depth of the nearest surface at each texel's centre.

#define ACCESS writeonly
#include "planes.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at.xy, ivec2(WIDTH)))) {
        return;
    }
    ivec2 texel = at.xy - MARGIN;
    Plane plane = planes[at.z];
    vec2 centre = vec2(texel) + 0.5, from_middle = centre - 0.5 * float(SIDE);
    precise float depth = MIDDLE + plane.tilt.z * (from_middle.x * plane.along.x + from_middle.y * plane.along.y);
    if (2 * texel.x >= SIDE) {
        depth -= height_of(centre.y) / plane.tilt.x;  // along the light
    }
    map[place_of(at.z, texel)] = depth;
}
