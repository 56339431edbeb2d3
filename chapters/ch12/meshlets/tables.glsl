// What task and mesh shaders read of culling: set 3 of the pipelines that draw meshlets (Vulkan alone). Set 0 is the
// scene's. Binding 0 is the view, which task shaders alone read.

#include "culling/records.glsl"

layout(set = 3, binding = 1, std430) readonly buffer Draws_ { Draw draws[]; };
layout(set = 3, binding = 2, std430) readonly buffer Meshlets_ { Meshlet meshlets[]; };
layout(set = 3, binding = 3, std430) readonly buffer Words_of_meshlets_ {
    uint meshlet_words[];  // of each meshlet: numbers of its vertices, then local indices, four in a word
};
layout(set = 3, binding = 4, std430) readonly buffer Offsets_ { uvec2 offsets[]; };
layout(set = 3, binding = 5, std430) buffer State_ { uint state[]; };
layout(set = 3, binding = 6, std430) readonly buffer Seen_ { uint seen[]; };
layout(set = 3, binding = 7, std430) buffer Visible_ { uint visible[]; };
layout(set = 3, binding = 8, std430) readonly buffer Pyramid_ { float pyramid[]; };
PUSH(Sizes, sizes)

#include "culling/words.glsl"

#include "culling/drawn.glsl"

uint first_unit(uint draw) { return first_units(draw).x; }

// The meshlets that a task shader hands to its mesh shaders: for each of them the instance, and the meshlet.
struct Payload {
    uvec2 chosen[32];
};
