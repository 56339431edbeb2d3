// A work group a bin of depth: the lights that reach into it, a bit each, and the first and the last of them.
//
// A light belongs to a bin if the two intervals overlap. To ask only for the ends and the middle of the light's interval
// would miss bins that lie between them.

layout(local_size_x = LIST_GROUP) in;

#include "clusters/records.glsl"

shared uint lowest[LIST_GROUP];
shared uint highest[LIST_GROUP];

void main() {
    uint bin = gl_WorkGroupID.x, lane = gl_LocalInvocationID.x;
    uint count = local_lights(), lights = pushed.header.x, words = pushed.header.y;
    uint first_code = light_lists[LIST_FIRST_BIN_CODE];
    uint low = 0xffffu, high = 0u;  // places from 1 on
    for (uint word = lane; word < words; word += uint(LIST_GROUP)) {
        uint bits = 0u, first = 32u * word;
        for (uint place = first; place < min(count, first + 32u); ++place) {
            vec2 interval = interval_at(first_bound(lights) + uint(LIST_BOUND) * place);
            if (interval.y >= 0.0 && bin_of(interval.x, first_code) <= bin && bin <= bin_of(interval.y, first_code)) {
                bits |= 1u << (place - first);
                low = min(low, place + 1u);
                high = place + 1u;
            }
        }
        light_lists[first_depth(lights) + bin * words + word] = bits;
    }
    lowest[lane] = low;
    highest[lane] = high;
    barrier();
    for (uint half_size = uint(LIST_GROUP) / 2u; half_size > 0u; half_size /= 2u) {
        if (lane < half_size) {
            lowest[lane] = min(lowest[lane], lowest[lane + half_size]);
            highest[lane] = max(highest[lane], highest[lane + half_size]);
        }
        barrier();
    }
    if (lane == 0u) {
        light_lists[first_bin(lights) + bin] = lowest[0] | highest[0] << 16;
    }
}
