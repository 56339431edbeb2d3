// From linear, pre-exposed light to what a display shows: tone curve, then the sRGB code.

#include "tone.glsl"
#include "tone_curves.glsl"
#include "srgb.glsl"
#ifdef VIEW_COUNT
#include "palette.glsl"
#endif
#include "post/finish.glsl"

layout(SOURCE(0)) uniform sampler2D color_hdr;

#ifdef RATE_TEXEL
#include "rates/codes.glsl"
layout(SOURCE(1)) uniform usampler2D rates;
#endif

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    vec3 color = texelFetch(color_hdr, ivec2(gl_FragCoord.xy), 0).rgb;
#ifdef DISPLAY_EXPOSURE
    color *= DISPLAY_EXPOSURE;
#endif
#ifdef NEUTRAL
    color = tone_neutral(color);
#elif defined(REINHARD)
    color = tone_reinhard(color, WHITE);
#elif defined(ACES)
    color = tone_aces(color);
#endif
#ifdef DISPLAY_GAMMA
    color = pow(clamp(color, 0.0, 1.0), vec3(1.0 / DISPLAY_GAMMA));
#endif
#if !defined(VIEW_COUNT) && !defined(VIEW_VALUE)
    out_color = vec4(srgb_from_linear(clamp(color, 0.0, 1.0)), 1.0);
#elif defined(VIEW_COUNT)
    // A view that counts; what has nothing to count is grey.
    out_color = vec4(color.r < 0.0 ? vec3(0.2) : heat(color.r / float(COUNT_FULL)), 1.0);
#else
    out_color = vec4(color, 1.0);  // a view whose values are codes already
#endif
#ifdef RATE_TEXEL
    out_color.rgb *= tint_of(texelFetch(rates, ivec2(gl_FragCoord.xy) / RATE_TEXEL, 0).r);
#endif
#if defined(DITHER) || defined(SPLIT)
    out_color.rgb = finished(out_color.rgb, ivec2(gl_FragCoord.xy));
#endif
}
