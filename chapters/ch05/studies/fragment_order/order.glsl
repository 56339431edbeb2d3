// Study fragment-order: push constants of both draws, and the list that the first one writes and the second one reads.

struct Push {
    uvec4 numbers;  // width and height of the picture, room in the list
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) ACCESS buffer Nodes_ {
    uint nodes[];  // y in the upper half, x in the lower one
};
