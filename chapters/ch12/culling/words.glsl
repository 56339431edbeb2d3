// Places in the buffers of culling. The including shader declares `draws`, `offsets`, `state` and the constants `sizes`.
//
// A draw has two numbers of units: x those of task shaders, y those of the kernels. Without mesh shaders x is 0.

uint phase() { return sizes.more.x; }
bool tells() { return sizes.counts.z != 0u; }

// Words of the arguments of a phase: 0 to 2 the dispatch over units, 3 the number of units; 4 to 6 the dispatch that writes
// commands, 7 the number of drawn units, 8 the number of units of task shaders.
uint argument_word() { return PHASES * COUNTER_WORDS + phase() * ARGUMENT_WORDS; }
uint draw_sum_word(uint block) { return sizes.firsts.y + 2u * (phase() * sizes.firsts.w + block); }
uint unit_sum_word(uint block) { return sizes.firsts.z + 2u * block; }
uint offset_place(uint draw) { return phase() * sizes.counts.x + draw; }

// The units before a draw; after the last draw all of them.
uvec2 first_units(uint draw) {
    uint word = argument_word();
    if (draw >= sizes.counts.x) {
        return uvec2(state[word + 8u], state[word + 3u]);
    }
    word = draw_sum_word(draw / 256u);
    return uvec2(state[word], state[word + 1u]) + offsets[offset_place(draw)];
}

uint group_number() { return gl_WorkGroupID.x + gl_WorkGroupID.y * gl_NumWorkGroups.x; }
