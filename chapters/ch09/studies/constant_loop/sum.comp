// Study constant-loop: the mean of LENGTH neighbours of each element, weighted by a parabola that is 0 at both ends.
//
// With a constant LENGTH each weight of an unrolled loop is a number that the compiler finds.

layout(local_size_x = 64) in;

#ifndef LENGTH  // a define of this name takes its place
layout(constant_id = 0) const uint LENGTH = 0u;  // 0: as many as are pushed
#endif

struct Push {
    uvec4 numbers;  // x: elements, y: the first place of the results, z: taps
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) readonly buffer Noise_ { float noise[]; };
layout(BIND(0, 1, 1), std430) writeonly buffer Means_ { float means[]; };

void main() {
    uint i = gl_GlobalInvocationID.x, taps = LENGTH > 0u ? LENGTH : push.numbers.z;
    if (i >= push.numbers.x) {
        return;
    }
    float sum = 0.0, weights = 0.0;
    for (uint k = 0u; k < taps; ++k) {
        float t = (float(k) + 0.5) / float(taps), weight = t * (1.0 - t);
        sum += weight * noise[i + k];
        weights += weight;
    }
    means[push.numbers.y + i] = sum / weights;
}
