// From several samples of light in each pixel to one colour, summed in the order of their numbers.
//
// The plain mean is right for light, and wrong for what is shown. Where a lamp of 100 covers a quarter of a pixel, the
// mean is 25: as white as the lamp itself after tone mapping, and so is every pixel that it touches. The edge is as
// jagged as without samples. What an eye would average is what is shown. So the samples are averaged as the tone curve
// shows them, and the mean is taken back through the curve: tone mapping it gives that mean (Karis 2013 weights by
// 1 / (1 + peak), which is this for another curve). Light below the curve's bend is averaged as it is, to the bit.
//
// Of the curve only its course for the largest channel counts, t(p) = p up to the bend s, then 1 - d^2 / (p + d - s)
// with d = 1 - s. Close to 1 the number t has few digits left, while 1 - t has them all: so sums are over 1 - t.

#include "tone.glsl"

layout(BIND(0, 0, 0)) uniform sampler2DMS color_msaa;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

const float BEND = NEUTRAL_START;
const float ROOM = 1.0 - BEND;

float largest(vec3 color) {
    return max(color.r, max(color.g, color.b));
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 mean = vec4(0.0);
    vec3 left = vec3(0.0);  // from the mean to 1
    for (int i = 0; i < SAMPLES; ++i) {
        vec4 color = texelFetch(color_msaa, pixel, i);
#ifdef TONE_WEIGHTED
        float peak = largest(color.rgb);
        float to_one = 1.0 - peak;
        float weight = 1.0;
        if (peak > BEND) {
            to_one = ROOM * ROOM / (peak + ROOM - BEND);
            weight = (1.0 - to_one) / peak;
        }
        left += to_one + weight * (peak - color.rgb);
        color.rgb *= weight;
#endif
        mean += color;
    }
    mean /= float(SAMPLES);
#ifdef TONE_WEIGHTED
    left /= float(SAMPLES);
    float least = min(left.r, min(left.g, left.b));
    if (least < ROOM) {
        mean.rgb *= (ROOM * ROOM / least - ROOM + BEND) / largest(mean.rgb);
    }
#endif
    out_color = mean;
}
