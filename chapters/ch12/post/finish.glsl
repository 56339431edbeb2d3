// The end of the picture's last pass: finished(code, pixel) dithers, and shows the raw picture in its part of a split view.
// Without either there is no such function.
// SOURCE(number) is the binding of what the pass reads: behind those of the scene, if the number of the frame is read.

#ifdef DITHER
#include "scene/scene.glsl"
#include "dither.glsl"
#define SOURCE(number) BIND(1, number, 3 + number)
#else
#define SOURCE(number) BIND(0, number, number)
#endif

#ifdef SPLIT
#include "srgb.glsl"
layout(SOURCE(RAW)) uniform sampler2D color_raw;
#endif

#if defined(DITHER) || defined(SPLIT)
vec3 finished(vec3 code, ivec2 pixel) {
#ifdef DITHER
    code = dithered_code(code, interleaved_gradient(uvec2(pixel), frame.frame_index), DITHER);
#endif
#ifdef SPLIT
    if (pixel[SPLIT] < int(SPLIT_AT * float(textureSize(color_raw, 0)[SPLIT]) + 0.5)) {
        code = srgb_from_linear(clamp(texelFetch(color_raw, pixel, 0).rgb, 0.0, 1.0));
    }
#endif
    return code;
}
#endif
