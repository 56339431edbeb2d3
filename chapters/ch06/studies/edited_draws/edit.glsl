// Study edited-draws: commands, objects, and the test of both kernels.

struct Command {
    uint index_count;
    uint instance_count;
    uint first_index;
    int vertex_offset;
    uint first_instance;  // the draw record: material in the lower 16 bits, object in the upper 16
};

struct Push {
    vec4 circle;  // x and z of its middle, radius, square of the radius
    uvec4 parts;  // first draw and count of each part
    uvec4 asked;  // x: draws to ask for, or AS_VISIBLE
};
PUSH(Push, push)

const uint AS_VISIBLE = 0xffffffffu;

layout(BIND(0, 0, 0), std430) readonly buffer All_ {
    Command all[];
};
layout(BIND(0, 1, 1), std430) readonly buffer Objects_ {
    mat3x4 objects[];  // the rows of world_from_object
};
layout(BIND(0, 2, 2), std430) writeonly buffer Edited_ {
    Command edited[];
};

// Whether the object of a command lies inside the circle. `precise`: the CPU finds the same ones.
bool is_inside(Command command) {
    mat3x4 object = objects[command.first_instance >> 16];
    precise float x = object[0].w - push.circle.x, z = object[2].w - push.circle.y;
    precise float square = x * x + z * z;
    return square <= push.circle.w;
}
