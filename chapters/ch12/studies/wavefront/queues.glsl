// The queues of live paths and of paths with rays towards light: a place for each, and how large the next dispatches are.

shared uint group_size, group_first;

// Paths lie in blocks of 8 x 8 pixels, like the work groups of the loop.
bool pixel_of(uint i, out ivec2 pixel) {
    uint across = (COLUMNS + 7u) / 8u, block = i / 64u;
    uvec2 at = uvec2(block % across * 8u + i % 8u, block / across * 8u + i / 8u % 8u);
    pixel = ivec2(at + tile.first.xy);
    return all(lessThan(at, uvec2(COLUMNS, ROWS)));
}

// The place in a queue of an invocation that wants one: the whole group asks for its places at once.
uint place_in(uint counter, bool wanted) {
    bool first = gl_LocalInvocationIndex == 0u;
    if (first) {
        group_size = 0u;
    }
    barrier();
    uint own = wanted ? atomicAdd(group_size, 1u) : 0u;
    barrier();
    if (first) {
        group_first = atomicAdd(wave_head[counter], group_size);
    }
    barrier();
    return group_first + own;
}

void append_live(uint i, bool wanted, uint queue) {
    uint place = place_in(NEXT_LIVE, wanted);
    if (wanted) {
        wave[QUEUES * WAVE_PATHS + place][queue] = i;
    }
}

// One work group.
void next() {
    uint id = gl_LocalInvocationIndex;
    if (IS_LAST && TOLD + id <= LAST_TOLD) {
        wave_told[id] = wave_head[TOLD + id];
    }
    if (CLEARS && TOLD + id <= LAST_TOLD) {
        wave_head[TOLD + id] = 0u;
    }
    if (id != 0u || IS_LAST) {
        return;
    }
    uint live = CLEARS ? 0u : wave_head[NEXT_LIVE], shadows = CLEARS ? 0u : wave_head[NEXT_SHADOWS];
    wave_head[LIVE] = live;
    wave_head[SHADOWS] = shadows;
    wave_head[NEXT_LIVE] = 0u;
    wave_head[NEXT_SHADOWS] = 0u;
    if (CLEARS) {
        return;
    }
    uint groups[] = uint[](LIVE_GROUPS, SHADOW_GROUPS), counts[] = uint[](live, shadows);
    for (uint k = 0u; k < 2u; ++k) {
        wave_head[groups[k]] = (counts[k] + 63u) / 64u;
        wave_head[groups[k] + 1u] = wave_head[groups[k] + 2u] = 1u;
    }
    wave_head[TOLD] += (live + LANES - 1u) / LANES * LANES;
    wave_head[min(TOLD + 2u + ROUND, LAST_TOLD)] += live;
}
