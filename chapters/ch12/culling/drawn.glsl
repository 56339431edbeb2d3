// What a draw is drawn as: its mesh, or a coarser level of detail of it.
//
// The word of an instance in `seen` and `visible` has the bit SEEN, and above it the level that the early phase chose. All
// later kernels and task shaders read it there: computed again, it might be rounded to another level.

const uint SEEN = 1u, LEVEL_SHIFT = 1u;

#ifdef LEVELS
Draw at_level(Draw draw, uint level) {
    if (level > 0u) {
        Draw coarser = draws[sizes.counts.x + first_level(draw) + level - 1u];  // they follow the draws
        draw.first_meshlet = coarser.first_meshlet;
        draw.units = coarser.units;
        draw.first_index = coarser.first_index;
        draw.index_count = coarser.index_count;
        draw.flags = (draw.flags & ~WHOLE) | coarser.flags;
    }
    return draw;
}
#endif

Draw drawn_as(uint number) {
    Draw draw = draws[number];
#ifdef LEVELS
    draw = at_level(draw, visible[draw.instance] >> LEVEL_SHIFT);
#endif
    return draw;
}
