// Dither: noise below a step of 8 bits, which makes the mean over neighbouring codes right.

// A number in (0, 1) for a pixel in a frame: interleaved gradient noise (Jimenez 2014, "Next Generation Post Processing in
// Call of Duty: Advanced Warfare"), fract(52.9829189 fract(0.06711056 x + 0.00583715 y)). Its numbers are spread evenly
// over each 3x3 pixels. A frame shifts x and y by 5.588238, and 64 frames repeat. Fractions are whole numbers over 2^32:
// all devices have the same bits, and the largest pictures lose none.
float interleaved_gradient(uvec2 pixel, uint frame) {
    uint inner = pixel.x * 288237660u + pixel.y * 25070368u + (frame & 63u) * 1750839832u;
    uint high, low;
    umulExtended(inner, 4221604530u, high, low);
    return (float((52u * inner + high) >> 9) + 0.5) * (1.0 / 8388608.0);
}

// An even number in (0, 1) becomes one in (-1, 1) whose density is a triangle; smaller stays smaller.
float triangle_of(float even) {
    return even < 0.5 ? sqrt(2.0 * even) - 1.0 : 1.0 - sqrt(2.0 - 2.0 * even);
}

// Codes from 0 to 1 with noise of `steps` steps of 8 bits each way, rounded to whole steps. The rounding is done here:
// devices may be off by a tenth of a step where they convert to 8 bits, and would move what noise leaves near a half.
// The mean is the code, for whole `steps`; with a triangular density the variance is the same at all codes (Lipshitz,
// Wannamaker and Vanderkooy 1992, "Quantization and Dither: A Theoretical Survey").
//
// Where an end is nearer than `steps` such noise would go past it, and what is cut off there would be missing in the mean.
// There the noise is even in (-1/2, 1/2), times `steps` below 1. The result for a value v in the last step is then 1 with
// probability v, and else 0; floor(v + even) passes neither end, and its mean is v. At an end itself the noise is 0. A
// transfer function is off by up to 1e-4 of a step at white, so a thousandth of a step counts as the end.
vec3 dithered_code(vec3 code, float even, float steps) {
    vec3 value = 255.0 * code;
    vec3 room = min(value, 255.0 - value);
    vec3 noise = mix(vec3(steps * triangle_of(even)), vec3(min(steps, 1.0) * (even - 0.5)), lessThan(room, vec3(steps)));
    noise = mix(noise, vec3(0.0), lessThan(room, vec3(0.001)));
    return clamp(floor(value + noise + 0.5), 0.0, 255.0) / 255.0;
}
