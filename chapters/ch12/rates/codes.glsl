// The code of a shading rate, as VK_KHR_fragment_shading_rate has it: bits 0 and 1 are the binary logarithm of a block's
// height, bits 2 and 3 that of its width.

ivec2 block_of(uint code) { return ivec2(1) << (ivec2(code >> 2, code) & 3); }

// The factor of the picture with `rate_tint`.
vec3 tint_of(uint code) {
    ivec2 block = block_of(code);
    float longest = float(max(block.x, block.y));
    return longest < 2.0 ? vec3(1.0) : longest < 4.0 ? vec3(1.0, 0.35, 0.35) : vec3(0.35, 0.35, 1.0);
}

// The pixel of a block that is lit: that of gl_FragCoord in a coarse fragment, within the picture.
ivec2 lit_pixel(ivec2 origin, ivec2 block, ivec2 size) { return min(origin + block / 2, size - 1); }
