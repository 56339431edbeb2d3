// Turns the sums of blocks into the sums of all blocks before each, with one work group, and writes the arguments of the
// dispatches that follow. UNITS: those of blocks of units, else of draws.

#include "culling/lists.glsl"
#include "culling/sums.glsl"

uint groups_of(uint invocations) { return (invocations + 255u) / 256u; }

// A dispatch has at most 65535 groups along an axis.
void write_dispatch(uint word, uint groups) {
    uint rows = (groups + 65534u) / 65535u;
    state[word] = rows > 1u ? 65535u : groups;
    state[word + 1u] = max(rows, 1u);
    state[word + 2u] = 1u;
}

void main() {
#ifdef UNITS
    uint blocks = groups_of(state[argument_word() + 3u]), first = unit_sum_word(0u);
#else
    uint blocks = sizes.firsts.w, first = draw_sum_word(0u);
#endif
    // Each invocation adds up a run of blocks, and begins with the sum of the runs before its own.
    uint me = gl_LocalInvocationIndex, run = (blocks + 255u) / 256u;
    uint begin = min(me * run, blocks), end = min(begin + run, blocks);
    uvec2 own = uvec2(0u);
    for (uint block = begin; block < end; ++block) {
        own += uvec2(state[first + 2u * block], state[first + 2u * block + 1u]);
    }
    uvec2 total;
    uvec2 before = sum_before(own, total);
    for (uint block = begin; block < end; ++block) {
        uvec2 sum = uvec2(state[first + 2u * block], state[first + 2u * block + 1u]);
        state[first + 2u * block] = before.x;
        state[first + 2u * block + 1u] = before.y;
        before += sum;
    }
    if (me == 0u) {
        uint word = argument_word();
#ifdef UNITS
        state[word + 7u] = total.x;
        // The next kernel counts the commands of each batch as well.
        write_dispatch(word + 4u, groups_of(max(state[word + 3u], sizes.counts.y)));
#else
        uint kept = min(total.y, sizes.more.w);  // there are places for so many
        state[word + 3u] = kept;
        state[word + 8u] = total.x;
        state[phase() * COUNTER_WORDS + UNITS_DROPPED] += total.y - kept;
        write_dispatch(word, groups_of(kept));
#endif
    }
}
