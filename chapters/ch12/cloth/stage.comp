// One stage of one substep over all cloths: an invocation for each particle or each spring of a colour. Earlier stages
// are earlier dispatches, with barriers between them.

layout(local_size_x = THREADS) in;

struct Push {
    uvec4 stage;      // x: step, y: substep; z: 1 for half a kick, w: 1 for the last half; or z: colour, w: iteration
};
PUSH(Push, push)

#define STATE_ACCESS

#include "motion.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
#ifdef CONSTRAIN_STAGE
    uint place = places.w + push.stage.z * counts.x;
    uint s = incidence[place] + i;
    if (s >= incidence[place + counts.x]) {
        return;
    }
    i = springs[2u * s];
#endif
    if (i >= counts.y) {
        return;
    }
    Cloth cloth = read_cloth(cloth_of(i));
#ifdef RESET_STAGE
    if ((cloth.frame.run.y & RESET) != 0u) {
        reset(i, cloth);
    }
#else
    if (push.stage.x >= cloth.frame.run.x) {
        return;
    }
#ifdef BEGIN_STAGE
    begin(i, cloth, push.stage.x, push.stage.y, push.stage.z != 0u, push.stage.w != 0u);
#endif
#ifdef CONSTRAIN_STAGE
    constrain(s, push.stage.w);
#endif
#ifdef END_STAGE
    end(i, cloth, push.stage.x, push.stage.y, push.stage.w != 0u);
#endif
#endif
}
