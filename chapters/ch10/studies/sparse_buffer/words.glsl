// Study sparse-buffer: the buffer, the page at each of its places, and what a page holds.

layout(BIND(0, 0, 0), std430) readonly buffer Places_ { uint pages[]; };
layout(BIND(0, 1, 1), std430) ACCESS buffer Sparse_ { uint words[]; };

const uint NONE = 0xffffffffu;

// The number of the page above, and 24 bits of a hash below.
uint word_of(uint page, uint index) {
    return page << 24 | (index * 2654435761u + 40503u * page) >> 8;
}
