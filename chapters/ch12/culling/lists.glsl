// The tables of culling, and what its kernels write. All kernels have one layout of bindings and share one descriptor set:
// what one of them does not need is declared all the same.

#include "masks.glsl"
#include "culling/records.glsl"

layout(local_size_x = 256) in;  // GROUP

layout(BIND(0, 0, 0), std140) uniform View_ {
#include "frame_constants.glsl"
} view;  // that of the frame, unless culling is frozen

struct Instance {
#include "instance.glsl"
};
layout(BIND(0, 1, 0), std430) readonly buffer Instances_ { Instance instances[]; };
#ifdef INSTANCES_PER_PAGE
layout(BIND(0, 13, 12), std430) readonly buffer More_instances_ { Instance more_instances[]; };
#endif
#include "scene/instance_of.glsl"
layout(BIND(0, 2, 1), std430) readonly buffer Draws_ { Draw draws[]; };
layout(BIND(0, 3, 2), std430) readonly buffer Batches_ {
    uvec4 batches[];  // first draw, first command, capacity
};
layout(BIND(0, 4, 3), std430) readonly buffer Meshlets_ { Meshlet meshlets[]; };
layout(BIND(0, 5, 4), std430) buffer Offsets_ {
    uvec2 offsets[];  // of a draw within its block
};
layout(BIND(0, 6, 5), std430) buffer Places_ {
    uvec2 places[];  // of a unit within its block, with the highest bit if it is drawn; its draw
};
layout(BIND(0, 7, 6), std430) buffer Commands_ { uint commands[]; };  // 5 words each
layout(BIND(0, 8, 7), std430) buffer State_ { uint state[]; };
layout(BIND(0, 9, 8), std430) readonly buffer Seen_ {
    uint seen[];  // what the last frame saw: a word for each instance (drawn.glsl), then a bit for each unit
};
layout(BIND(0, 10, 9), std430) buffer Visible_ { uint visible[]; };  // the same of this frame
layout(BIND(0, 11, 10), std430) readonly buffer Pyramid_ { float pyramid[]; };
layout(BIND(0, 12, 11), std430) buffer Told_ { uint told[]; };  // the counters, for the CPU
PUSH(Sizes, sizes)

#include "culling/words.glsl"

#include "culling/drawn.glsl"

uint first_unit(uint draw) { return first_units(draw).y; }

// The number of drawn units before a unit; after the last one that of all drawn units.
uint drawn_before(uint unit) {
    if (unit >= state[argument_word() + 3u]) {
        return state[argument_word() + 7u];
    }
    return state[unit_sum_word(unit / 256u)] + (places[unit].x & ~DRAWN);
}
