// The error of a pixel, estimated from how its paths differ.

#include "luminance.glsl"

const float LEAST_PATHS = 32.0;   // fewer say too little of how much paths differ
const float DARK = 0.01;          // of white: darker pixels are held to this, where relative errors are not seen

// The square of the standard error of a pixel's luminance, relative to it. `sum` are colour in nits and number of its paths,
// `squares` is the sum of their squared luminances. Without two paths nothing is known, and it is 1.
float relative_error2(vec4 sum, float squares, float exposure) {
    float count = sum.a;
    if (count < 2.0) {
        return 1.0;
    }
    float mean = luminance(sum.rgb) / count, dark = DARK / exposure;
    float variance = max(squares / count - mean * mean, 0.0) / (count - 1.0);
    return variance / (mean * mean + dark * dark);
}
