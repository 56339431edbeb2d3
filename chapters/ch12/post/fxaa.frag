// Smoothing of edges in the finished picture: pixels with contrast are shifted across their edge by less than a pixel.
//
// Where both directions of an edge, or both sides of a pixel, are alike, no order of pixels decides: the pixel becomes the
// mean of the two shifts. What differs by no more than roundings is alike.

#include "fxaa.glsl"
#include "post/finish.glsl"

layout(SOURCE(0)) uniform sampler2D color_toned;

layout(location = 0) out vec4 out_color;

const float ALIKE = 1e-5;

vec3 code_at(ivec2 pixel) {
    return texelFetch(color_toned, clamp(pixel, ivec2(0), textureSize(color_toned, 0) - 1), 0).rgb;
}

float luma_at(ivec2 pixel) {
    return luma(code_at(pixel));
}

// The pixel's code after a shift towards `side`, one of its four neighbours.
vec3 shifted(ivec2 pixel, ivec2 side, vec3 code, float detail) {
    // Along the edge the mean of the two pixels beside it stays what it is here, until the edge takes a step or ends.
    float own = luma(code), other = luma_at(pixel + side);
    float mean = 0.5 * (own + other), change = 0.25 * abs(own - other);
    ivec2 along = ivec2(abs(side.y), abs(side.x));
    vec2 ends = vec2(float(STEPS) + 1.0);
    bvec2 bent = bvec2(false);
    for (int way = 0; way < 2; ++way) {
        ivec2 at = pixel;
        for (int i = 1; i <= STEPS; ++i) {
            at += way == 0 ? along : -along;
            float away = 0.5 * (luma_at(at) + luma_at(at + side)) - mean;
            if (abs(away) >= change - ALIKE) {
                ends[way] = float(i);
                bent[way] = (away < 0.0) != (own < mean);
                break;
            }
        }
    }
    return mix(code, code_at(pixel + side), max(fxaa_shift(ends, bent), detail));
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 code = code_at(pixel);
    float around[9];
    for (int i = 0; i < 9; ++i) {
        around[i] = luma_at(pixel + ivec2(i % 3, i / 3) - 1);
    }
    float contrast = fxaa_contrast(around, CONTRAST, LEAST_CONTRAST);
    if (contrast > 0.0) {
        float detail = fxaa_detail(around, contrast, DETAIL);
        vec2 bends = fxaa_bends(around);
        vec4 sum = vec4(0.0);
        for (int axis = 0; axis < 2; ++axis) {
            if (bends[axis] < max(bends.x, bends.y) - ALIKE) {
                continue;
            }
            ivec2 side = axis == 0 ? ivec2(0, 1) : ivec2(1, 0);
            float before = abs(around[axis == 0 ? 1 : 3] - around[4]);
            float after = abs(around[axis == 0 ? 7 : 5] - around[4]);
            vec4 of_axis = vec4(0.0);
            if (before >= after - ALIKE) {
                of_axis += vec4(shifted(pixel, -side, code, detail), 1.0);
            }
            if (after >= before - ALIKE) {
                of_axis += vec4(shifted(pixel, side, code, detail), 1.0);
            }
            sum += of_axis;
        }
        code = sum.rgb / sum.a;
    }
#if defined(DITHER) || defined(SPLIT)
    code = finished(code, pixel);
#endif
    out_color = vec4(code, 1.0);
}
