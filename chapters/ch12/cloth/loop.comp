// All steps of a frame in one dispatch, for any number of steps. GROUP invocations share the particles of a cloth, with
// barriers between stages; if GROUP is 0, one invocation simulates each cloth.
//
// A loop that contains a barrier runs equally often for all invocations of a group, since its bounds are those of the
// cloth. Barriers require that.

#if GROUP > 0
layout(local_size_x = GROUP) in;
#define STATE_ACCESS coherent
#define SYNC memoryBarrierBuffer(); barrier()
#else
layout(local_size_x = THREADS) in;
#define STATE_ACCESS
#define SYNC
#endif

#include "motion.glsl"

#define FOR_PARTICLES(call) for (uint i = own.x + mine; i < own.x + own.y; i += stride) { call; }

void constrain_all(uint c, uint mine, uint stride) {
    for (uint iteration = 0u; iteration < cut.y; ++iteration) {
        for (uint color = 0u; color < counts.w; ++color) {
            uint place = places.w + color * counts.x + c;
            uint last = incidence[place + 1u];
            for (uint s = incidence[place] + mine; s < last; s += stride) {
                constrain(s, iteration);
            }
            SYNC;
        }
    }
}

void main() {
#if GROUP > 0
    uint c = gl_WorkGroupID.x;
    uint mine = gl_LocalInvocationID.x;
    uint stride = GROUP;
#else
    uint c = gl_GlobalInvocationID.x;
    uint mine = 0u;
    uint stride = 1u;
    if (c >= counts.x) {
        return;
    }
#endif
    uvec2 own = cloths[c].particles;
    Cloth cloth = read_cloth(c);
    if ((cloth.frame.run.y & RESET) != 0u) {
        FOR_PARTICLES(reset(i, cloth))
    }
    SYNC;  // unconditional: a CPU's compiler splits here, and would duplicate all code up to the first barrier
    for (uint step = 0u; step < cloth.frame.run.x; ++step) {
        for (uint substep = 0u; substep < cut.x; ++substep) {
            // Verlet kicks by h/2 at both ends of a step, and by h in between, where two halves meet.
            uint kicks = cut.z != 0u && substep == cut.x - 1u ? 2u : 1u;
            for (uint k = 0u; k < kicks; ++k) {
                bool at_end = k == 1u;
                FOR_PARTICLES(begin(i, cloth, step, substep, cut.z != 0u && (substep == 0u || at_end), at_end))
                SYNC;
                if (cut.w != 0u) {
                    constrain_all(c, mine, stride);
                }
                FOR_PARTICLES(end(i, cloth, step, substep, at_end))
                SYNC;
            }
        }
    }
}
