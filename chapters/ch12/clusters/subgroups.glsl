// The scalarised loop: invocations that run together go through the union of their lights in step.
//
// Each of them alone would take its own way through its own words. Here the words, the bits and so the number of the light
// are the same for all, and a compiler may keep the light in scalar registers and read it once. A light of another
// invocation adds exactly nothing here, so the sums are those of the plain loop.

uvec2 joined_words(uint first, uint end) { return uvec2(subgroupMin(first), subgroupMax(end)); }

uint joined_bits(uint bits) { return subgroupOr(bits); }
