// A pixel of the picture from samples that were drawn at a scale: those of the 3x3 drawn pixels around its place, weighted by
// a kernel over their distances in pixels of the picture (Yang, Liu and Salvi 2020, "A survey of temporal antialiasing
// techniques", section 3.2).
//
// Sums of weights over the frames of a mean are kept in `history_weight`. So the mean is that of all samples, each with the
// weight of its distance, in whichever frame it was drawn.

#include "taa/drawn.glsl"

struct Drawn {
    ivec2 pixel;       // the nearest drawn pixel
    vec3 color;        // the mean of the samples by the kernel
    vec3 between;      // a wider mean, without holes between samples, for a pixel that has no history
    float weight;      // the sum of the weights
    float confidence;  // the weight of the nearest sample, 1 at the pixel's centre
};

Drawn drawn = Drawn(ivec2(0), vec3(0.0), vec3(0.0), 0.0, 0.0);

// The least weight: that of samples farther away than the kernel reaches, if a pixel at the border has no others.
const float LEAST_WEIGHT = 1e-5;

// An axis of the kernel: the window of Harris over KERNEL_RADIUS pixels.
float kernel(vec2 offset) {
    return max(blackman_harris(offset * (1.5 / KERNEL_RADIUS)), LEAST_WEIGHT);
}

Drawn drawn_for(ivec2 pixel, ivec2 size) {
    vec2 place = drawn_place(pixel, size), enlarged = vec2(size) / frame.size.xy;
    Drawn found;
    found.pixel = drawn_pixel(place);
    found.weight = 0.0;
    found.confidence = 0.0;
    ivec2 last = ivec2(frame.size.xy) - 1;
    vec3 nearest = finite_color(texelFetch(color_hdr, found.pixel, 0).rgb), sum = vec3(0.0), wide = vec3(0.0);
    float wide_weight = 0.0;
    for (int i = 0; i < 9; ++i) {
        ivec2 at = found.pixel + ivec2(i % 3 - 1, i / 3 - 1);
        vec2 offset = vec2(at) + 0.5 - place;
        vec3 away = finite_color(texelFetch(color_hdr, clamp(at, ivec2(0), last), 0).rgb) - nearest;
        float weight = kernel(offset * enlarged), part = max(tent(offset), LEAST_WEIGHT);
        sum += weight * away;
        found.weight += weight;
        found.confidence = max(found.confidence, weight);
        wide += part * away;
        wide_weight += part;
    }
    found.color = nearest + sum / found.weight;
    found.between = nearest + wide / wide_weight;
    return found;
}
