// Tests each draw by the bounds of its instance, and counts the units of those that are left.
//
// Early phase: a draw is left if the last frame saw it. Late phase: it is left unless it is hidden behind the early ones.

#include "culling/lists.glsl"
#include "culling/counters.glsl"
#include "culling/sums.glsl"
#include "culling/tests.glsl"
#include "culling/levels.glsl"

// Returns whether the draw is left, and counts why not.
bool is_left(Draw draw, Instance instance) {
    count(DRAWS_TESTED, 1u);
    if ((draw.flags & ALWAYS) != 0u || CULLING == 0) {
        return true;
    }
#if CULLING >= 3 && PHASE == 0
    if ((view.valid_histories & HISTORY_FRAME) != 0u && (seen[draw.instance] & SEEN) == 0u) {
        count(DRAWS_HIDDEN, 1u);
        return false;
    }
#endif
    Bounds bounds = bounds_of_instance(instance);
    if (outside(bounds)) {
        count(DRAWS_OUTSIDE, 1u);
        return false;
    }
#if CULLING >= 3 && PHASE == 1
    if (hidden(bounds)) {
        count(DRAWS_HIDDEN, 1u);
        return false;
    }
#endif
    return true;
}

void main() {
    uint number = group_number() * 256u + gl_LocalInvocationIndex;
    begin_counting();
    uvec2 units = uvec2(0u);
    if (number < sizes.counts.x) {
        Draw draw = draws[number];
        Instance instance = instance_of(draw.instance);
        bool left = is_left(draw, instance);
        uint level = 0u;
#ifdef LEVELS
#if PHASE == 0
        level = level_in_view(draw, instance);
#else
        level = visible[draw.instance] >> LEVEL_SHIFT;  // the early phase chose it
#endif
        draw = at_level(draw, level);
#endif
#if CULLING < 3 || PHASE == 1
        visible[draw.instance] = (left ? SEEN : 0u) | level << LEVEL_SHIFT;
        count(DRAWS_COARSER, left && level > 0u ? 1u : 0u);
#elif defined(LEVELS)
        visible[draw.instance] = level << LEVEL_SHIFT;
#endif
        units.y = left ? draw.units : 0u;
#ifdef MESH_SHADERS
        units = (draw.flags & WHOLE) != 0u ? units : units.yx;  // meshlets are for the task shaders
#endif
    }
    uvec2 total;
    uvec2 before = sum_before(units, total);
    if (number < sizes.counts.x) {
        offsets[offset_place(number)] = before;
    }
    if (gl_LocalInvocationIndex == 0u) {
        uint word = draw_sum_word(group_number());
        state[word] = total.x;
        state[word + 1u] = total.y;
    }
    end_counting();
}
