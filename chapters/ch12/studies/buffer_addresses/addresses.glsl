// Addresses: 64 bits in two words, the low one first.

// The address of a word behind an address. 2^30 words and more lead beyond 4 GiB: the offset has two words, too.
uvec2 address_of(uvec2 base, uint word) {
    uint carry;
    uint low = uaddCarry(base.x, word << 2, carry);
    return uvec2(low, base.y + (word >> 30) + carry);
}
