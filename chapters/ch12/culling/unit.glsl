// The tests of one unit, the same for the kernel and for the task shader. LIST: 0 units of task shaders, 1 of kernels.

// The draw that has a unit: a binary search over the sums of blocks, then over the draws of a block.
uint draw_of(uint unit) {
    uint low = 0u, high = sizes.firsts.w;  // the block is in [low, high)
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        if (state[draw_sum_word(middle) + LIST] <= unit) { low = middle; } else { high = middle; }
    }
    uint within = unit - state[draw_sum_word(low) + LIST];
    uint first = low * 256u, end = min(first + 256u, sizes.counts.x);
    while (end - first > 1u) {
        uint middle = (first + end) / 2u;
        if (offsets[offset_place(middle)][LIST] <= within) { first = middle; } else { end = middle; }
    }
    return first;
}

uint triangles_of(Draw draw, uint unit) {
    return (draw.flags & WHOLE) != 0u ? draw.index_count / 3u : meshlets[draw.first_meshlet + unit].counts >> 8u;
}

// Why this phase does not draw unit number `unit` of a draw: a counter, or COUNTERS if it draws it.
//
// The late phase leaves out what the early phase has drawn, and writes down for the next frame what is visible now. It
// reads only what others wrote before, so it says the same however often it is asked: several passes draw a phase.
uint why_not(Draw draw, Instance instance, uint unit) {
    bool whole = (draw.flags & WHOLE) != 0u, is_visible = true;
    if (CULLING >= 1 && !whole) {  // the test of its instance was that of a whole mesh
        Meshlet meshlet = meshlets[draw.first_meshlet + unit];
        Bounds bounds = bounds_of_meshlet(instance, meshlet.sphere, meshlet.extent);
        if (outside(bounds)) {
            return UNITS_OUTSIDE;
        }
        if (CULLING >= 2 && (draw.flags & TWO_SIDED) == 0u
            && faces_away(instance.world_from_object, bounds, meshlet.cone, meshlet.sphere)) {
            return UNITS_AWAY;
        }
#if CULLING >= 3 && PHASE == 1
        is_visible = !hidden(bounds);
#endif
    }
#if CULLING >= 3
    bool history = (view.valid_histories & HISTORY_FRAME) != 0u, always = (draw.flags & ALWAYS) != 0u;
    uint bit = draw.first_bit + unit, word = sizes.more.z + bit / 32u, mask = 1u << (bit & 31u);
    uint last = seen[draw.instance];
    bool other_level = last >> LEVEL_SHIFT != visible[draw.instance] >> LEVEL_SHIFT;  // its bits say nothing
    bool was_seen = (last & SEEN) != 0u && (other_level || (seen[word] & mask) != 0u);
    bool drawn_early = !history || always || was_seen;
#if PHASE == 0
    return drawn_early ? COUNTERS : UNITS_HIDDEN;
#else
    if (is_visible) {
        atomicOr(visible[word], mask);
    } else {
        atomicAnd(visible[word], ~mask);
        return UNITS_HIDDEN;
    }
    return drawn_early ? UNITS_DRAWN : COUNTERS;
#endif
#else
    return COUNTERS;
#endif
}

bool draws_unit(Draw draw, Instance instance, uint unit) {
    uint reason = why_not(draw, instance, unit);
    bool drawn = reason == COUNTERS;
    count(UNITS_TESTED, 1u);
    count(reason, drawn || reason == UNITS_DRAWN ? 0u : 1u);
    count(UNITS_DRAWN, drawn ? 1u : 0u);
    count(MESHLETS_DRAWN, drawn && (draw.flags & WHOLE) == 0u ? 1u : 0u);
    count(TRIANGLES_DRAWN, drawn ? triangles_of(draw, unit) : 0u);
    return drawn;
}
