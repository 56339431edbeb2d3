// The exposure of the next frame, from what this frame's picture measured. One work group.
//
// The state of adaptation is a float: log2 of the exposure with a histogram, luminance in nits with a mip chain. The first
// frame after a reset has the exposure of its view, and the second one the target itself; from then on the state goes
// towards the target.

layout(local_size_x = BINS) in;

#include "scene/scene.glsl"
#include "adaptation.glsl"
#include "hdr/bins.glsl"

#if MODE_MIPS
layout(BIND(1, 0, 4), std430) coherent buffer Luminance_ { float nits[MIP_FLOATS]; };
#else
layout(BIND(1, 0, 4), std430) buffer Histogram_ { uint bins[2 * BINS]; };
shared uint counts[BINS];
shared uint places[BINS];
#endif
layout(BIND(1, 1, 5), std430) buffer Next_ { vec4 of_view; vec4 adapted; } next;
layout(BIND(1, 2, 6), std430) buffer Told_ { vec4 told; };  // x: exposure of this frame, for outputs in nits

#if MODE_MIPS

// The mean of all texels: each level halves the one before, down to one texel.
float mean_luminance() {
    uint source = 0u;
    for (uint side = SIDE / 2; side >= 1u; side /= 2u) {
        uint target = source + 4u * side * side;
        for (uint i = gl_LocalInvocationIndex; i < side * side; i += BINS) {
            uint first = source + (i / side) * 4u * side + 2u * (i % side);
            float above = nits[first] + nits[first + 1u];
            nits[target + i] = 0.25 * (above + (nits[first + 2u * side] + nits[first + 2u * side + 1u]));
        }
        memoryBarrierBuffer();
        barrier();
        source = target;
    }
    return nits[MIP_FLOATS - 1];
}

#else

// The mean of log2 luminance over the pixels between two percentiles; `found` is false if no pixel counts.
float mean_log2(out bool found) {
    uint total = 0u;
    for (int bin = 0; bin < BINS; ++bin) {
        total += counts[bin];
    }
    found = total > 0u;
    float low = LOW * float(total), high = HIGH * float(total);
    float weights = 0.0, sum = 0.0, steps = float(place_steps());
    uint before = 0u;
    for (int bin = 0; bin < BINS; ++bin) {
        uint count = counts[bin];
        float inside = min(high, float(before + count)) - max(low, float(before));
        if (inside > 0.0) {
            weights += inside;
            sum += inside * (float(bin) + float(places[bin]) / (steps * float(count)));
        }
        before += count;
    }
    return LOG2_LOWEST + BIN_WIDTH * sum / max(weights, 1e-6);
}

#endif

void main() {
    uint i = gl_LocalInvocationIndex;
    bool first = exposed.of_view.z == 0.0;
    float now = exposure(), state, later;
#if MODE_MIPS
    float mean = mean_luminance();
    // Without any light that counts, the view's exposure stays.
    float wanted = mean > 0.0 ? mean : KEY / exposed.of_view.x;
    float target = clamp(wanted, KEY * exp2(-LOG2_MOST), KEY * exp2(-LOG2_LEAST));
    state = first ? target : adapted(exposed.adapted.z, target, ADAPT_SPEED, 1e3 * frame.delta_time);
    later = KEY / state;
#else
    counts[i] = bins[i];
    places[i] = bins[i + BINS];
    bins[i] = 0u;  // for the next frame
    bins[i + BINS] = 0u;
    barrier();
    if (i > 0u) {
        return;
    }
    bool found;
    float mean = mean_log2(found);
    float target = found ? clamp(log2(KEY) - mean, LOG2_LEAST, LOG2_MOST) : log2(exposed.of_view.x);
    float before = exposed.adapted.z;
    float tau = target > before ? ADAPT_DARK_S : ADAPT_BRIGHT_S;
    state = first ? target : approached(before, target, tau, frame.delta_time);
    later = exp2(state);
#endif
    if (i == 0u) {
        next.adapted = vec4(later, now, state, mean);
        told = vec4(now, later, mean, 0.0);
    }
}
