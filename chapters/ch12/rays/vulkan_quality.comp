// How large groups of neighbours in the order of a structure are: the sum of the surfaces of their boxes, over that of the
// box around all. A driver does not tell what its boxes cost; but its tree was built for triangles that were near one
// another, and where this figure has changed they no longer are as they were. One work group, sums in one order.

layout(local_size_x = 256) in;

struct Push {
    uvec4 run;  // x: first word of the indices, y: triangles, z: first word of the positions, w: where the figure is written
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) readonly buffer Indices_ { uint indices[]; };
layout(BIND(0, 1, 0), std430) readonly buffer Words_ { uint words[]; };
layout(BIND(0, 2, 0), std430) writeonly buffer Costs_ { float costs[]; };

const uint NEIGHBOURS = 8u;
const vec3 INSIDE_OUT = vec3(3.0e38);

shared float sums[256];
shared vec3 lows[256];
shared vec3 highs[256];

float area(vec3 low, vec3 high) {
    vec3 size = max(high - low, 0.0);
    return size.x * size.y + size.y * size.z + size.z * size.x;
}

void main() {
    uint me = gl_LocalInvocationIndex;
    vec3 low_of_all = INSIDE_OUT, high_of_all = -INSIDE_OUT;
    float sum = 0.0;
    for (uint first = NEIGHBOURS * me; first < push.run.y; first += NEIGHBOURS * 256u) {
        vec3 low = INSIDE_OUT, high = -INSIDE_OUT;
        uint end = 3u * min(first + NEIGHBOURS, push.run.y);
        for (uint corner = 3u * first; corner < end; ++corner) {
            uint at = push.run.z + 3u * indices[push.run.x + corner];
            vec3 place = uintBitsToFloat(uvec3(words[at], words[at + 1u], words[at + 2u]));
            if (all(lessThanEqual(abs(place), vec3(1e18)))) {  // not so with NaN
                low = min(low, place);
                high = max(high, place);
            }
        }
        sum += low.x <= high.x ? area(low, high) : 0.0;
        low_of_all = min(low_of_all, low);
        high_of_all = max(high_of_all, high);
    }
    sums[me] = sum;
    lows[me] = low_of_all;
    highs[me] = high_of_all;
    for (uint half_ = 128u; half_ > 0u; half_ /= 2u) {
        barrier();
        if (me < half_) {
            sums[me] += sums[me + half_];
            lows[me] = min(lows[me], lows[me + half_]);
            highs[me] = max(highs[me], highs[me + half_]);
        }
    }
    if (me == 0u) {
        float all_ = lows[0].x <= highs[0].x ? area(lows[0], highs[0]) : 0.0;
        costs[push.run.w] = all_ > 0.0 ? sums[0] / all_ : 0.0;
    }
}
