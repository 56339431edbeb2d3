// What task and mesh shaders read of the casters' lists: set 3 of the pipelines that draw to layers (Vulkan alone).

#include "culling/records.glsl"
#include "mesh_layers/rows.glsl"

layout(set = 3, binding = 0, std430) readonly buffer Draws_ { Draw draws[]; };
layout(set = 3, binding = 1, std430) readonly buffer Meshlets_ { Meshlet meshlets[]; };
layout(set = 3, binding = 2, std430) readonly buffer Words_of_meshlets_ { uint meshlet_words[]; };
layout(set = 3, binding = 3, std430) readonly buffer Lists_ { uvec2 lists[]; };   // shadows/cull.glsl has these two
layout(set = 3, binding = 4, std430) readonly buffer Numbers_ { uint numbers[]; };
layout(set = 3, binding = 5, std430) readonly buffer Rows_ { uvec4 rows[]; };

struct Round {
    uvec4 first;  // x: the first face among those that are drawn, y: layers of the target, z: places of a list, w: lists
    uvec4 batch;  // x: its number, y: the number of batches, z: its first place in a list
};
PUSH(Round, pushed)

// What a task group hands to its mesh shaders: the draw and the meshlet of each entry, and for each mesh shader an entry,
// with the layer from bit 8 on. A light has at most six faces.
struct Payload {
    uvec2 chosen[TASK_ENTRIES];
    uint drawn[6u * TASK_ENTRIES];
};
