// Choosing one of many with given probabilities in a constant number of steps, by a table of aliases (Walker 1974; Vose
// 1991).
//
// The table is made by common/numerics/alias_table.py. It has a power of two of entries, all equally likely to be
// drawn; an entry stands for itself or for its alias. Its words:
//
//     x   threshold: the entry stands for itself where 32 random bits are below it
//     y   its alias
//     z   the probability with which the entry's own number is chosen, a float
//     w   the same of its alias

// The entry that `bits` draw, of `entries` (a power of two): by the highest bits, where a low-discrepancy sequence is
// even.
uint alias_entry(uint bits, uint entries) {
    uint high, low;
    umulExtended(bits, entries, high, low);
    return high;
}

// The number that entry `drawn` with the given words stands for, and the probability with which it is chosen. `bits`
// are to be independent of those that drew the entry.
uint alias_pick(uint drawn, uvec4 words, uint bits, out float probability) {
    bool own = bits < words.x;
    probability = uintBitsToFloat(own ? words.z : words.w);
    return own ? drawn : words.y;
}
