// Base colours as the G-buffer stores them. A target of format sRGB applies the code by itself. A compute shader stores to no
// such image, so it computes the code (BASE_COLOR_CODED), and readers undo it.

#ifdef BASE_COLOR_CODED
#include "srgb.glsl"

vec3 kept_color(vec3 color) { return srgb_from_linear(clamp(color, 0.0, 1.0)); }

vec3 found_color(sampler2D colors, ivec2 pixel) { return linear_from_srgb(texelFetch(colors, pixel, 0).rgb); }
#else
vec3 kept_color(vec3 color) { return color; }

vec3 found_color(sampler2D colors, ivec2 pixel) { return texelFetch(colors, pixel, 0).rgb; }
#endif
