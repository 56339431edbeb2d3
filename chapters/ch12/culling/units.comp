// Tests each unit of the draws that are left: one invocation for each meshlet, or whole mesh.

#include "culling/lists.glsl"
#include "culling/counters.glsl"
#include "culling/sums.glsl"
#include "culling/tests.glsl"

const uint LIST = 1u;
#include "culling/unit.glsl"

void main() {
    uint number = group_number() * 256u + gl_LocalInvocationIndex;
    begin_counting();
    bool drawn = false;
    uint owner = 0u;
    if (number < state[argument_word() + 3u]) {
        owner = draw_of(number);
        Draw draw = drawn_as(owner);
        drawn = draws_unit(draw, instance_of(draw.instance), number - first_unit(owner));
    }
    uvec2 total;
    uvec2 before = sum_before(uvec2(drawn ? 1u : 0u, 0u), total);
    if (number < state[argument_word() + 3u]) {
        places[number] = uvec2(before.x | (drawn ? DRAWN : 0u), owner);
    }
    if (gl_LocalInvocationIndex == 0u && group_number() * 256u < state[argument_word() + 3u]) {
        uint word = unit_sum_word(group_number());
        state[word] = total.x;
        state[word + 1u] = 0u;
    }
    end_counting();
}
