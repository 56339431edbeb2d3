// Copies the draw commands of blended objects, with 0 instances for those that are not seen. Their order stays: farthest
// first. They are tested once, against the depth of everything solid.

#include "masks.glsl"

layout(local_size_x = 256) in;

layout(BIND(0, 0, 0), std140) uniform View_ {
#include "frame_constants.glsl"
} view;

struct Instance {
#include "instance.glsl"
};
layout(BIND(0, 1, 0), std430) readonly buffer Instances_ { Instance instances[]; };
#ifdef INSTANCES_PER_PAGE
layout(BIND(0, 6, 5), std430) readonly buffer More_instances_ { Instance more_instances[]; };
#endif
#include "scene/instance_of.glsl"
layout(BIND(0, 2, 1), std430) readonly buffer Source_ { uint source[]; };
layout(BIND(0, 3, 2), std430) writeonly buffer Target_ { uint target[]; };
layout(BIND(0, 4, 3), std430) readonly buffer Pyramid_ { float pyramid[]; };
layout(BIND(0, 5, 4), std430) writeonly buffer Visible_ { uint visible[]; };

struct Range {
    uvec4 range;  // first command, commands
};
PUSH(Range, of)

#include "culling/tests.glsl"

bool is_seen(Instance instance) {
    if ((instance.flags & INSTANCE_DEFORMING) != 0u || CULLING == 0) {
        return true;
    }
    Bounds bounds = bounds_of_instance(instance);
#if CULLING >= 3
    return !outside(bounds) && !hidden(bounds);
#else
    return !outside(bounds);
#endif
}

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number >= of.range.y) {
        return;
    }
    uint word = 5u * (of.range.x + number), instance = source[word + 4u];
    bool drawn = is_seen(instance_of(instance));
    visible[instance] = drawn ? 1u : 0u;
    target[word] = source[word];
    target[word + 1u] = drawn ? source[word + 1u] : 0u;
    target[word + 2u] = source[word + 2u];
    target[word + 3u] = source[word + 3u];
    target[word + 4u] = instance;
}
