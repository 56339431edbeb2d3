// What the finished picture asks of the next one: each pixel is lit where luminance changes. A work group is a texel of the
// mask. It reads each pixel once, with a border of one pixel around them, and the gradient comes from shared memory.
//
// The gradient is that of the luminance code, since the eye sees ratios: 0 is black, 1 is white.
// Source: Sobel and Feldman, "A 3x3 isotropic gradient operator for image processing", 1968.

layout(local_size_x = RATE_TEXEL, local_size_y = RATE_TEXEL) in;

#include "luminance.glsl"
#include "tone.glsl"
#include "tone_curves.glsl"
#include "srgb.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D color_hdr;
layout(BIND(0, 1, 0), r32ui) uniform writeonly uimage2D history_rates;

const int BORDERED = RATE_TEXEL + 2;
shared float tile[BORDERED][BORDERED];
shared uint edges;

float code_at(ivec2 pixel) {
    vec3 color = texelFetch(color_hdr, clamp(pixel, ivec2(0), textureSize(color_hdr, 0) - 1), 0).rgb;
#ifdef NEUTRAL
    color = tone_neutral(color);
#elif defined(REINHARD)
    color = tone_reinhard(color, WHITE);
#elif defined(ACES)
    color = tone_aces(color);
#endif
    return srgb_from_linear(vec3(luminance(clamp(color, 0.0, 1.0)))).r;
}

void main() {
    ivec2 first = ivec2(gl_WorkGroupID.xy) * RATE_TEXEL - 1, at = ivec2(gl_LocalInvocationID.xy);
    int number = int(gl_LocalInvocationIndex);
    if (number == 0) {
        edges = 0u;
    }
    for (int i = number; i < BORDERED * BORDERED; i += RATE_TEXEL * RATE_TEXEL) {
        tile[i / BORDERED][i % BORDERED] = code_at(first + ivec2(i % BORDERED, i / BORDERED));
    }
    barrier();
    int x = at.x, y = at.y;
    float across = tile[y][x] - tile[y][x + 2] + 2.0 * (tile[y + 1][x] - tile[y + 1][x + 2]) + tile[y + 2][x] - tile[y + 2][x + 2];
    float down = tile[y][x] + 2.0 * tile[y][x + 1] + tile[y][x + 2] - tile[y + 2][x] - 2.0 * tile[y + 2][x + 1] - tile[y + 2][x + 2];
    // Sobel compares pixels that are two apart, so it does not see lines of one pixel. A step from a pixel to its neighbour
    // counts as the gradient of an edge of that height.
    float right = 4.0 * (tile[y + 1][x + 2] - tile[y + 1][x + 1]), below = 4.0 * (tile[y + 2][x + 1] - tile[y + 1][x + 1]);
    float squared = max(across * across + down * down, max(right * right, below * below));
    bool inside = all(lessThan(first + 1 + at, textureSize(color_hdr, 0)));
    if (inside && !(squared <= THRESHOLD)) {  // what is no number is an edge
        atomicOr(edges, 1u);
    }
    barrier();
    if (number == 0) {
        imageStore(history_rates, ivec2(gl_WorkGroupID.xy), uvec4(edges != 0u ? 0u : COARSE));
    }
}
