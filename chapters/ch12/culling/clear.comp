// Lets every command of a phase draw no instance, for devices that do not read the number of draws from a buffer.

#include "culling/lists.glsl"

void main() {
    uint number = group_number() * 256u + gl_LocalInvocationIndex;
    if (number < sizes.more.y) {
        commands[5u * (phase() * sizes.more.y + number) + 1u] = 0u;
    }
}
