// An invocation for each tile and each 32 lights: a bit is set if the light may reach any pixel of the tile.
//
// From the eye a tile is a narrow cone, and a sphere is one, too: they meet if the angle between their axes is at most
// the sum of their half angles. This is a dot product a light. The rectangle around a sphere would cover 4/pi times its
// disc. A tile of a small, wide picture may span 90 degrees and more from its middle: that is no cone, and takes all lights.
// 8x8 tiles of a group ask the same 32 lights, which are read once.

layout(local_size_x = 8, local_size_y = 8) in;

#include "clusters/records.glsl"

shared vec4 spheres[32];  // direction, cosine
shared vec2 others[32];   // sine, end of the interval of depth

const float ROUNDING = 4e-6;  // of a dot product of unit vectors, and of the cosine of a sum

// The direction in the view through a point of the picture, in pixels; of an orthographic view its x and y, in metres.
vec3 through(vec2 pixel) {
    vec2 ndc = pixel * (2.0 * frame.size.zw) - 1.0;
    vec4 in_view = frame.view_from_clip * vec4(ndc, 1.0, 1.0);
    return frame.orthographic != 0u ? vec3(in_view.xy, 0.0) : normalize(in_view.xyz);
}

void main() {
    uint lane = gl_LocalInvocationIndex, lights = pushed.header.x;
    uint word = gl_WorkGroupID.z, first = 32u * word;
    uint count = local_lights();
    if (lane < 32u && first + lane < count) {
        uint at = first_bound(lights) + uint(LIST_BOUND) * (first + lane);
        vec4 sphere = uintBitsToFloat(uvec4(
            light_lists[at], light_lists[at + 1u], light_lists[at + 2u], light_lists[at + 3u]
        ));
        spheres[lane] = sphere;
        others[lane] = uintBitsToFloat(uvec2(light_lists[at + 4u], light_lists[at + 6u]));
    }
    barrier();
    uvec2 tile = gl_GlobalInvocationID.xy;
    uint side = 1u << pushed.header.w, across = pushed.header.z;
    uint down = (uint(frame.size.y) + side - 1u) >> pushed.header.w;
    if (tile.x >= across || tile.y >= down) {
        return;
    }
    vec2 corner = vec2(tile * side);
    vec3 axis = through(corner + 0.5 * float(side));
    vec3 corners[4] = vec3[4](
        through(corner),
        through(corner + vec2(float(side), 0.0)),
        through(corner + vec2(0.0, float(side))),
        through(corner + float(side))
    );
    uint size = first < count ? min(count - first, 32u) : 0u, bits = 0u;
    if (frame.orthographic != 0u) {
        float radius = 1.0001 * length(corners[3] - axis);
        for (uint i = 0u; i < size; ++i) {
            float reach = spheres[i].w + radius;
            vec2 offset = spheres[i].xy - axis.xy;
            bits |= dot(offset, offset) <= reach * reach && others[i].y >= 0.0 ? 1u << i : 0u;
        }
    } else {
        float cosine = 1.0;
        for (uint i = 0u; i < 4u; ++i) {
            cosine = min(cosine, dot(axis, corners[i]));
        }
        cosine = clamp(cosine - ROUNDING, 0.0, 1.0);
        float sine = sqrt(1.0 - cosine * cosine);
        for (uint i = 0u; i < size; ++i) {
            float apart = spheres[i].w * cosine - others[i].x * sine;  // cosine of the sum of the half angles
            bool meets = cosine == 0.0 || dot(spheres[i].xyz, axis) >= apart - ROUNDING;
            bits |= meets && others[i].y >= 0.0 ? 1u << i : 0u;
        }
    }
    light_lists[first_tile(lights, pushed.header.y) + (tile.y * across + tile.x) * pushed.header.y + word] = bits;
}
