// Study separable-bloom: 11 texels of a row or of a column, weighted. At the border the last texel stands for all beyond.

#define ACCESS writeonly
#include "texels.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

const float taps[11] = float[](TAPS);

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    const ivec2 along = ivec2(1 - AXIS, AXIS);
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 11; ++i) {
        ivec2 texel = clamp(at + (i - 5) * along, ivec2(0), ivec2(SIDE - 1));
        sum += taps[i] * from[texel.y * SIDE + texel.x].rgb;
    }
    to[at.y * SIDE + at.x] = vec4(sum / 133.0, 1.0);
}
