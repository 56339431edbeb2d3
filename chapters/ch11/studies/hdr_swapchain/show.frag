// Study hdr-swapchain, for a picture of 8 bits: what the surface is sent, four times. From above: as a display of 8-bit
// sRGB shows it, bright light clipped; the signal itself, as numbers; luminance in false colours; and luminance as a curve.

#include "signal.glsl"
#include "luminance.glsl"
#include "palette.glsl"
#include "srgb.glsl"
#include "strips.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D encoded;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

// Nits in primaries of Rec. 709, from a signal.
vec3 nits_of(vec3 signal) {
#if ENCODING == HDR10
    return max(rec709_from_rec2020(nits_from_pq(signal)), 0.0);
#elif ENCODING == SCRGB
    return signal * SCRGB_WHITE;
#else
    return linear_from_srgb(signal) * PAPER_WHITE;
#endif
}

// Decades from 0.1 nits (0) to 10,000 nits (1).
float decades(float nits) { return (log2(max(nits, 1e-6)) * 0.30102999566 + 1.0) / 5.0; }

bool line_at(float place, float at, float pixel) { return abs(place - at) < 0.5 * pixel; }

// The curve of the white strip: height is the PQ code, whatever the encoding. Lines: 1, 10, 100, 1000 nits in grey, paper
// white in white, the peak in red; orange is the light without the roll-off.
vec3 curve(float up, float pixel, vec3 white) {
    float height = pq_from_nits(max(white.r, max(white.g, white.b)));
    float asked = pq_from_nits(PAPER_WHITE * exp2(stops_at(in_uv.x)));
    vec3 color = up < height ? vec3(0.16, 0.2, 0.28) : vec3(0.05, 0.05, 0.06);
    for (float nits = 1.0; nits < 2000.0; nits *= 10.0) {
        color = line_at(up, pq_from_nits(nits), pixel) ? vec3(0.32) : color;
    }
    color = line_at(up, pq_from_nits(PAPER_WHITE), pixel) ? vec3(0.8) : color;
    color = line_at(up, pq_from_nits(PEAK), pixel) ? vec3(0.85, 0.2, 0.15) : color;
    color = line_at(up, asked, 2.0 * pixel) ? vec3(0.95, 0.6, 0.15) : color;
    return line_at(up, height, 2.0 * pixel) ? vec3(0.45, 0.75, 1.0) : color;
}

void main() {
    ivec2 size = textureSize(encoded, 0);
    float place = in_uv.y * 4.0, within = fract(place);
    int band = min(int(place), 3);
    int strip = band == 3 ? 0 : min(int(within * float(STRIPS)), STRIPS - 1);
    ivec2 texel = ivec2(int(gl_FragCoord.x), (2 * strip + 1) * size.y / (2 * STRIPS));
    vec3 signal = texelFetch(encoded, texel, 0).rgb, nits = nits_of(signal);
    vec3 color = srgb_from_linear(min(nits / PAPER_WHITE, 1.0));
    if (band == 1) {
        color = clamp(signal, 0.0, 1.0);
    } else if (band == 2) {
        color = heat(decades(luminance(nits)));
    } else if (band == 3) {
        color = curve(1.0 - within, 4.0 / float(size.y), nits);
    }
    // A dark line between the parts.
    out_color = vec4(within * float(size.y) < 8.0 && band > 0 ? vec3(0.05, 0.05, 0.06) : color, 1.0);
}
