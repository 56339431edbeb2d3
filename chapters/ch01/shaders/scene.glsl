// What every pass of this chapter sees of the scene: set 0, written once per frame and slot.

#include "frame_constants.glsl"
#include "instance.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ { FrameConstants frame; };
layout(BIND(0, 1, 0), std430) readonly buffer Instances_ { Instance instances[]; };

// The only thing that differs between two draws of one pipeline.
struct Push {
    uvec4 draw;  // x: instance
};
PUSH(Push, push)
