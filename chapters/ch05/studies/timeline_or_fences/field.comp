// Study timeline-or-fences, the kernel: waves that run outwards, as numbers of a field.

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 numbers;  // phase of the waves, cells along an edge
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) writeonly buffer Field_ {
    uint field[];
};

void main() {
    uvec2 cell = gl_GlobalInvocationID.xy;
    uint cells = push.numbers.y;
    if (cell.x >= cells || cell.y >= cells) {
        return;
    }
    ivec2 out_from = ivec2(cell) * 2 - int(cells - 1u);
    uint far = uint(out_from.x * out_from.x + out_from.y * out_from.y);
    // Integers: the same on every GPU, and a cell of another frame is visible at once.
    field[cell.y * cells + cell.x] = (far / 16u - push.numbers.x) & 255u;
}
