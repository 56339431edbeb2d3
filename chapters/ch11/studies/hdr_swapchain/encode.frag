// Study hdr-swapchain, the last pass: scene light becomes the signal that the surface takes.

#include "signal.glsl"
#include "srgb.glsl"

layout(BIND(0, 0, 0)) uniform sampler2D light;

layout(location = 0) out vec4 out_color;

void main() {
    vec3 nits = displayed_nits(texelFetch(light, ivec2(gl_FragCoord.xy), 0).rgb, PAPER_WHITE, KNEE, PEAK);
#if ENCODING == HDR10
    // Vulkan and OpenGL let a driver store either of the two codes beside a value, and the software drivers store
    // floor(1024 x), which is the wrong one of them for half of all values. A value just above a whole code leaves no
    // choice, so the code that is nearest is stored everywhere.
    vec3 signal = (round(pq_from_nits(rec2020_from_rec709(nits)) * 1023.0) + 0.0005) / 1023.0;
#elif ENCODING == SCRGB
    vec3 signal = scrgb_from_nits(nits);
#else
    vec3 signal = srgb_from_linear(min(nits / PAPER_WHITE, 1.0));
#endif
    out_color = vec4(signal, 1.0);
}
