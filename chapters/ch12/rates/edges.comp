// What the finished picture asks of the next one: each pixel is lit where luminance changes. A work group has a tile of
// whole texels, and an invocation for each 2x2 pixels. The code of each pixel is found once, with a border of one pixel
// around the tile, and gradients come from shared memory.
//
// The gradient is that of the luminance code, since the eye sees ratios: 0 is black, 1 is white.
// Source: Sobel and Feldman, "A 3x3 isotropic gradient operator for image processing", 1968.

layout(local_size_x = EDGE_TILE / 2, local_size_y = EDGE_TILE / 2) in;

#include "luminance.glsl"
#include "tone.glsl"
#include "tone_curves.glsl"
#include "srgb.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D color_hdr;
layout(BIND(0, 1, 1)) uniform usampler2D rates;
layout(BIND(0, 2, 0), r32ui) uniform writeonly uimage2D history_rates;

layout(constant_id = 0) const int STILL = 0;  // frames without a change

const int BORDERED = EDGE_TILE + 2, TEXELS = EDGE_TILE / RATE_TEXEL, INVOCATIONS = EDGE_TILE * EDGE_TILE / 4;
shared float tile[BORDERED * BORDERED];
shared uint edges[TEXELS * TEXELS];

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

// The squared gradient at a pixel of the tile. Sobel compares pixels that are two apart, so it does not see lines of one
// pixel: a step from a pixel to its neighbour counts as the gradient of an edge of that height.
float squared_gradient(int middle) {
    int above = middle - BORDERED, under = middle + BORDERED;
    float left = tile[above - 1] + 2.0 * tile[middle - 1] + tile[under - 1];
    float right = tile[above + 1] + 2.0 * tile[middle + 1] + tile[under + 1];
    float up = tile[above - 1] + 2.0 * tile[above] + tile[above + 1];
    float down = tile[under - 1] + 2.0 * tile[under] + tile[under + 1];
    vec2 gradient = vec2(left - right, up - down);
    vec2 step = 4.0 * (vec2(tile[middle + 1], tile[under]) - tile[middle]);
    return max(dot(gradient, gradient), max(step.x * step.x, step.y * step.y));
}

void main() {
    ivec2 first = ivec2(gl_WorkGroupID.xy) * EDGE_TILE, within = 2 * ivec2(gl_LocalInvocationID.xy);
    int number = int(gl_LocalInvocationIndex);
    if (STILL >= LAST) {  // all edges are known: the next frame finds this frame's mask in place of edges
        for (int i = number; i < TEXELS * TEXELS; i += INVOCATIONS) {
            ivec2 texel = ivec2(gl_WorkGroupID.xy) * TEXELS + ivec2(i % TEXELS, i / TEXELS);
            imageStore(history_rates, texel, texelFetch(rates, texel, 0));
        }
        return;
    }
    for (int i = number; i < TEXELS * TEXELS; i += INVOCATIONS) {
        edges[i] = 0u;
    }
    for (int i = number; i < BORDERED * BORDERED; i += INVOCATIONS) {
        tile[i] = code_at(first - 1 + ivec2(i % BORDERED, i / BORDERED));
    }
    barrier();
    bool edge = false;
    for (int i = 0; i < 4; ++i) {
        ivec2 at = within + ivec2(i & 1, i >> 1);
        bool inside = all(lessThan(first + at, textureSize(color_hdr, 0)));
        // What is no number is an edge.
        edge = edge || inside && !(squared_gradient((at.y + 1) * BORDERED + at.x + 1) <= THRESHOLD);
    }
    ivec2 texel = within / RATE_TEXEL;
    if (RATE_TEXEL == 2) {  // a texel for each invocation
        imageStore(history_rates, ivec2(gl_WorkGroupID.xy) * TEXELS + texel, uvec4(edge ? 0u : COARSE));
        return;
    }
    if (edge) {
        atomicOr(edges[texel.y * TEXELS + texel.x], 1u);
    }
    barrier();
    for (int i = number; i < TEXELS * TEXELS; i += INVOCATIONS) {
        ivec2 texel = ivec2(gl_WorkGroupID.xy) * TEXELS + ivec2(i % TEXELS, i / TEXELS);
        imageStore(history_rates, texel, uvec4(edges[i] != 0u ? 0u : COARSE));
    }
}
