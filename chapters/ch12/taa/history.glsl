// The history between texels: bilinear, and bicubic by Catmull-Rom. The history holds linear RGB.
//
// Texels are fetched and weighted here, so that the sampler's filter and its fraction of eight bits do not matter. Beyond
// the border the texels of the border are repeated. A NaN counts as 0, an infinity as the largest colour, and what is below 0
// as 0: one bad texel must not live in the history, nor spread.
//
// The sum is the nearest texel plus weighted differences from it: weights then sum to exactly 1, a constant stays the same to
// the bit, and where uv is the centre of a texel the result is that texel to the bit.

#include "finite.glsl"

// Splits uv into the texel at its upper left and the fraction of the way to the next one.
// A texel's centre as a uv has an error of some units of the last place, which a factor of `size` makes 2^-21 of the place:
// what is as near to a centre is that centre, or a view at rest would be filtered in each frame.
void split_uv(vec2 uv, ivec2 size, out ivec2 first, out vec2 part) {
    vec2 place = uv * vec2(size) - 0.5, whole = round(place);
    bvec2 centred = lessThanEqual(abs(place - whole), (abs(whole) + 1.0) / 2097152.0);
    place = clamp(mix(place, whole, centred), vec2(-3.0), vec2(size) + 2.0);  // whole numbers beyond are undefined
    vec2 before = floor(place);
    first = ivec2(before);
    part = place - before;
}

vec3 history_texel(sampler2D image, ivec2 texel, ivec2 last) {
    return finite_color(texelFetch(image, clamp(texel, ivec2(0), last), 0).rgb);
}

vec3 bilinear(sampler2D image, vec2 uv) {
    ivec2 size = textureSize(image, 0), last = size - 1, first;
    vec2 part;
    split_uv(uv, size, first, part);
    vec3 nearest = history_texel(image, first + ivec2(greaterThanEqual(part, vec2(0.5))), last);
    if (part == vec2(0.0)) {
        return nearest;
    }
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 4; ++i) {
        ivec2 corner = ivec2(i & 1, i >> 1);
        vec2 weights = mix(1.0 - part, part, vec2(corner));
        sum += weights.x * weights.y * (history_texel(image, first + corner, last) - nearest);
    }
    return nearest + sum;
}

// Weights of the four texels -1, 0, 1, 2 at the fraction f of the way from 0 to 1. They reproduce quadratic functions.
vec4 catmull_rom_weights(float f) {
    return vec4(
        f * (-0.5 + f * (1.0 - 0.5 * f)),
        1.0 + f * f * (-2.5 + 1.5 * f),
        f * (0.5 + f * (2.0 - 1.5 * f)),
        f * f * (-0.5 + 0.5 * f)
    );
}

// Negative lobes, down to -0.0735, make light below 0 beside a bright texel: the result is at least 0.
vec3 catmull_rom(sampler2D image, vec2 uv) {
    ivec2 size = textureSize(image, 0), last = size - 1, first;
    vec2 part;
    split_uv(uv, size, first, part);
    vec3 nearest = history_texel(image, first + ivec2(greaterThanEqual(part, vec2(0.5))), last);
    if (part == vec2(0.0)) {
        return max(nearest, 0.0);
    }
    vec4 across = catmull_rom_weights(part.x), down = catmull_rom_weights(part.y);
    vec3 sum = vec3(0.0);
    for (int y = 0; y < 4; ++y) {
        vec3 row = vec3(0.0);
        for (int x = 0; x < 4; ++x) {
            row += across[x] * (history_texel(image, first + ivec2(x, y) - 1, last) - nearest);
        }
        sum += down[y] * row;
    }
    return max(nearest + sum, 0.0);
}
