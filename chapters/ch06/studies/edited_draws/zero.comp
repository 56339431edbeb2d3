// Study edited-draws: keeps every command at its place, and draws no instance of those outside the circle.

#include "edit.glsl"

layout(local_size_x = 64) in;

void main() {
    uint i = gl_GlobalInvocationID.x;
    uvec4 parts = push.parts;
    if (i >= parts.y + parts.w) {
        return;
    }
    Command command = all[i];
    command.instance_count = is_inside(command) ? command.instance_count : 0u;
    edited[i] = command;
}
