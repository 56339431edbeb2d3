// Study types-16bit, the kernel: y = (a x + b) >> shift in 16-bit integers, and g = c h + d in halves, two of each.

#define ACCESS writeonly
#include "numbers.glsl"
#include "half.glsl"

#if NEAREST
// Ask for rounding of 16-bit floats to the nearest, ties to even: execution mode RoundingModeRTE.
#extension GL_EXT_spirv_intrinsics : require
spirv_execution_mode(extensions = ["SPV_KHR_float_controls"], capabilities = [4467], 4462, 16);
#endif

layout(local_size_x = 256) in;

// The lower 16 bits of the result matter; they come from the lower 16 bits of all operands.
int integer(int value) {
    int sum = int(push.integers.x) * value + int(push.integers.y);
    return bitfieldExtract(sum, 0, 16) >> push.integers.z;  // the sign is that of bit 15
}

uint half_sum(uint bits) {
    precise float product = half_value(push.halves.x) * half_value(bits);
    precise float sum = half_value(half_bits(product)) + half_value(push.halves.y);
    return half_bits(sum);
}

void main() {
    uint pair = gl_GlobalInvocationID.x;
    if (pair >= push.integers.w) {
        return;
    }
#if WAY == 0
    int16_t a = int16_t(push.integers.x), b = int16_t(push.integers.y), shift = int16_t(push.integers.z);
    float16_t c = uint16BitsToFloat16(uint16_t(push.halves.x)), d = uint16BitsToFloat16(uint16_t(push.halves.y));
    for (uint i = 2u * pair; i < 2u * pair + 2u; ++i) {
        y[i] = (a * x[i] + b) >> shift;
        precise float16_t product = c * h[i];  // `precise`: no fused multiply-add, which would round once
        precise float16_t sum = product + d;
        g[i] = sum;
    }
#elif WAY == 1
    int both = int(x[pair]);
    uint low = uint(integer(bitfieldExtract(both, 0, 16))), high = uint(integer(bitfieldExtract(both, 16, 16)));
    y[pair] = low & 0xffffu | high << 16;
    g[pair] = half_sum(h[pair] & 0xffffu) | half_sum(h[pair] >> 16) << 16;
#else
    for (uint i = 2u * pair; i < 2u * pair + 2u; ++i) {
        y[i] = uint(integer(int(x[i])));
        g[i] = half_sum(h[i]);
    }
#endif
}
