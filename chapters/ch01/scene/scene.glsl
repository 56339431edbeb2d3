// What every pass of this chapter sees of the scene: set 0, written once per frame and slot.

layout(BIND(0, 0, 0), std140) uniform Frame_ {
#include "frame_constants.glsl"
} frame;

#include "masks.glsl"
struct Instance {
#include "instance.glsl"
};
layout(BIND(0, 1, 0), std430) readonly buffer Instances_ { Instance instances[]; };

// The only thing that differs between two draws of one pipeline.
struct Push {
    uvec4 draw;  // x: instance
};
PUSH(Push, push)
