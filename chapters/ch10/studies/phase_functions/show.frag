// Study phase-functions: lobes on the left, their radius the logarithm of the light; errors of both forms on the right.

#include "phase.glsl"
#include "asked.glsl"

layout(BIND(0, 1, 1), std430) readonly buffer Values_ { vec4 values[]; };
layout(BIND(0, 2, 2), std430) readonly buffer Truth_ { vec2 truth[]; };

layout(location = 0) out vec4 out_color;

const vec3 PAPER = vec3(0.05, 0.05, 0.06);
const float DECADES = 7.5;  // of the radius: from 10^-3 of what an isotropic particle scatters

float log10_of(float value) { return log2(max(value, 1e-30)) * 0.30102999566; }

vec3 color_of(uint lobe) { return mix(vec3(0.2, 0.4, 0.95), vec3(1.0, 0.7, 0.15), float(lobe) / float(LOBES - 1)); }

// How far outside of a lobe a place is; places are in units of the largest radius.
float outside(vec2 place, float g) {
    float far = length(place);
    float turned = one_minus_cosine(vec3(1.0, 0.0, 0.0), vec3(place / max(far, 1e-6), 0.0));
    return far - (log10_of(henyey_greenstein(turned, g) * 12.566370614) + 3.0) / DECADES;
}

vec3 lobes(vec2 pixel, vec2 size) {
    float scale = 1.0 / (0.62 * size.x);
    vec2 place = (pixel - vec2(0.36 * size.x, 0.5 * size.y)) * scale;
    vec3 color = PAPER;
    float ring = length(place) * DECADES;
    if (abs(ring - round(ring)) < 0.4 * scale * DECADES && ring > 0.5) {
        color += 0.08;
    }
    for (uint lobe = 0u; lobe < LOBES; ++lobe) {
        float g = g_of(lobe), here = outside(place, g);
        if (here < 0.0) {
            color = mix(color, color_of(lobe), 0.12);
        }
    }
    for (uint lobe = 0u; lobe < LOBES; ++lobe) {
        float g = g_of(lobe), here = outside(place, g);
        vec2 slope = vec2(outside(place + vec2(scale, 0.0), g), outside(place + vec2(0.0, scale), g)) - here;
        if (abs(here) < 0.8 * length(slope)) {
            color = color_of(lobe);
        }
    }
    return color;
}

// The height of a bar, 0 to 1, for a relative error of 10^-8 to 1.
float height(float value, vec2 exact) {
    float off = abs(((value - exact.x) - exact.y) / exact.x);
    return clamp(log10_of(off) / 8.0 + 1.0, 0.0, 1.0);
}

vec3 bars(ivec2 pixel, ivec2 size) {
    int row = min(pixel.y * int(LOBES) / size.y, int(LOBES) - 1), end = (row + 1) * size.y / int(LOBES);
    float up = (float(end - 1 - pixel.y) + 0.5) * float(LOBES) / float(size.y) / 0.9;
    if (up > 1.0) {
        return PAPER;
    }
    uint first = uint(pixel.x * int(POINTS) / size.x), last = uint((pixel.x + 1) * int(POINTS) / size.x);
    vec2 highest = vec2(0.0);
    for (uint point = first; point < max(last, first + 1u); ++point) {
        uint at = uint(row) * POINTS + point;
        highest = max(highest, vec2(height(values[at].y, truth[at]), height(values[at].z, truth[at])));
    }
    vec3 color = PAPER + (fract(up * 8.0) < 0.08 ? 0.1 : 0.03);
    color = up < highest.y ? vec3(0.8, 0.16, 0.12) : color;
    return up < highest.x ? vec3(0.25, 0.7, 0.3) : color;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), size = ivec2(asked.size.xy);
    int middle = size.x * 3 / 5;
    vec3 color = pixel.x < middle ? lobes(gl_FragCoord.xy, vec2(middle, size.y))
        : bars(pixel - ivec2(middle, 0), ivec2(size.x - middle, size.y));
    out_color = vec4(color, 1.0);
}
