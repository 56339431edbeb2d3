// What the 3x3 pixels around a pixel show in the current frame: the box of their values, their mean and standard deviation,
// and the picture at the pixel's centre. Per channel, in whatever colour space the samples have; samples are finite.

#include "filters.glsl"

struct Neighbourhood {
    vec3 low;
    vec3 high;
    vec3 mean;
    vec3 deviation;  // of the nine, not of a larger set of which they are a part: the sum is divided by 9
    vec3 filtered;   // may be outside low and high, and below 0, for a filter with negative lobes
};

// `samples` are the 3x3 pixels in rows. A jitter moves the picture right and down by `jitter_px`, so pixel p of the frame
// shows what the steady picture has at p - jitter: that is where its sample lies.
//
// Sums are of differences from the pixel itself, so that nine equal samples give themselves to the bit and a deviation of
// exactly 0. The deviation is that of differences from the mean, never below 0, while the difference of moments, m2 / 9 -
// mean^2, loses all digits where the mean is large.
Neighbourhood gathered(vec3 samples[9], vec2 jitter_px) {
    Neighbourhood n;
    vec3 centre = samples[4];
    n.low = samples[0];
    n.high = samples[0];
    precise vec3 sum = vec3(0.0), weighted = vec3(0.0), squares = vec3(0.0);
    precise float weight_sum = 0.0;
    for (int i = 0; i < 9; ++i) {
        n.low = min(n.low, samples[i]);
        n.high = max(n.high, samples[i]);
        sum += samples[i] - centre;
#if FILTER != 0
        float weight = sample_weight(vec2(i % 3 - 1, i / 3 - 1) - jitter_px);
        weighted += weight * (samples[i] - centre);
        weight_sum += weight;
#endif
    }
    precise vec3 mean = centre + sum / 9.0;
    for (int i = 0; i < 9; ++i) {
        precise vec3 away = samples[i] - mean;
        squares += away * away;
    }
    n.mean = mean;
    n.deviation = sqrt(squares / 9.0);
#if FILTER == 0
    n.filtered = centre;  // also for a jitter of more than half a pixel
#else
    precise vec3 filtered = centre + weighted / weight_sum;
    n.filtered = filtered;
#endif
    return n;
}
