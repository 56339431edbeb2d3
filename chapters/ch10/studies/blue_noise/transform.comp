// Study blue-noise: the discrete Fourier transform of an error, a work group for each line of each image: rows, then
// columns, each by its definition. The power is |X|^2 / texels / variance: white noise of one frame has 1 in the mean.
// An error is real, so the bins of -x and -y have the power of those of x and y: half of the columns are enough.

#include "light.glsl"

layout(local_size_x = SIZE) in;

layout(BIND(0, 1, 1), std430) readonly buffer Images_ { float images[]; };
layout(BIND(0, 2, 2), std430) readonly buffer Turns_ { vec2 turns[]; };
layout(BIND(0, 3, 3), std430) buffer Lines_ { vec2 lines[]; };
layout(BIND(0, 4, 4), std430) writeonly buffer Powers_ { float powers[]; };

const uint LAST = SIZE - 1, MIDDLE = SIZE / 2;

shared vec2 line[SIZE], turn[SIZE];

vec2 product(vec2 a, vec2 b) { return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x); }

void main() {
    uint i = gl_LocalInvocationIndex, number = gl_WorkGroupID.x, image = gl_WorkGroupID.y;
    uint way = image / KINDS, kind = image % KINDS;
    turn[i] = turns[i];
    if (asked.columns == 0u) {
        float value = images[((way * IMAGES + NOISES + kind) * SIZE + number) * SIZE + i];
        line[i] = vec2(value / summed(kind) - light_at(i) * white_of(kind), 0.0);
    } else {
        line[i] = lines[(image * SIZE + i) * SIZE + number];
    }
    barrier();
    if (asked.columns == 0u && i > MIDDLE) {
        return;
    }
    vec2 sum = vec2(0.0);
    for (uint k = 0u; k < SIZE; ++k) {
        sum += product(line[k], turn[i * k & LAST]);
    }
    if (asked.columns == 0u) {
        lines[(image * SIZE + number) * SIZE + i] = sum;
        return;
    }
    float power = dot(sum, sum) / (float(SIZE * SIZE) * variance(kind));
    powers[(image * SIZE + i) * SIZE + number] = power;
    if (number > 0u && number < MIDDLE) {
        powers[(image * SIZE + (-i & LAST)) * SIZE + SIZE - number] = power;
    }
}
