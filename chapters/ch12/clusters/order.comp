// An invocation a light: its place in the order of depth is the number of lights before it. Of equal ones the first in
// the scene comes first, so the order depends on nothing else.
//
// All pairs are compared: n^2 comparisons, of which each group keeps a part of the keys in shared memory. A few thousand
// lights take less time than the many passes of a sort that compares fewer.

layout(local_size_x = LIST_GROUP) in;

#include "clusters/records.glsl"

shared uint codes[LIST_GROUP];
shared float ends[LIST_GROUP];

void main() {
    uint number = gl_GlobalInvocationID.x, lane = gl_LocalInvocationID.x;
    uint count = local_lights(), lights = pushed.header.x;
    uint from = first_found(lights);
    bool inside = number < count;
    uint own = inside ? light_lists[from + uint(LIST_BOUND) * number + 7u] : 0u;
    uint place = 0u;
    float farthest = 0.0;
    for (uint first = 0u; first < count; first += uint(LIST_GROUP)) {
        uint other = from + uint(LIST_BOUND) * (first + lane);
        bool there = first + lane < count;
        codes[lane] = there ? light_lists[other + 7u] : 0u;
        ends[lane] = there ? interval_at(other).y : 0.0;
        barrier();
        uint size = min(count - first, uint(LIST_GROUP));
        for (uint i = 0u; i < size; ++i) {
            place += codes[i] < own || (codes[i] == own && first + i < number) ? 1u : 0u;
            farthest = ends[i] < 1e17 ? max(farthest, ends[i]) : farthest;  // the bins end where most lights do
        }
        barrier();
    }
    if (number == 0u) {
        uint last = depth_code(farthest > 0.0 ? farthest : 1.0);
        light_lists[LIST_FIRST_BIN_CODE] = max(last, uint(LIST_BINS)) - uint(LIST_BINS) + 1u;
    }
    if (inside) {
        light_lists[uint(LIST_HEADER) + place] = light_count.y + number;
        uint to = first_bound(lights) + uint(LIST_BOUND) * place;
        for (uint i = 0u; i < uint(LIST_BOUND); ++i) {
            light_lists[to + i] = light_lists[from + uint(LIST_BOUND) * number + i];
        }
    }
}
