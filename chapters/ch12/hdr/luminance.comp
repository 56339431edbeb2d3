// The picture's luminance in nits at 64x64 texels. Each texel is the mean over its area of the picture, with the parts of
// pixels that its border cuts: a single tap would miss small lights, or show them as large as a texel.

layout(local_size_x = 8, local_size_y = 8) in;

#include "scene/scene.glsl"
#include "luminance.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D color_hdr;
#ifdef SKIP_EMPTY
layout(BIND(1, 1, 4)) uniform sampler2D depth;
layout(BIND(1, 2, 4), std430) writeonly buffer Luminance_ { float nits[MIP_FLOATS]; };
#else
layout(BIND(1, 1, 4), std430) writeonly buffer Luminance_ { float nits[MIP_FLOATS]; };
#endif
#include "hdr/measured.glsl"

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(color_hdr, 0);
    vec2 first = vec2(texel * size) / float(SIDE), end = vec2((texel + 1) * size) / float(SIDE);
    ivec2 begin = ivec2(floor(first)), stop = min(ivec2(ceil(end)), size);
    float sum = 0.0;
    for (int y = begin.y; y < stop.y; ++y) {
        float high = min(float(y + 1), end.y) - max(float(y), first.y);
        for (int x = begin.x; x < stop.x; ++x) {
            float wide = min(float(x + 1), end.x) - max(float(x), first.x);
            vec3 light;
            float value = measured_light(ivec2(x, y), light) ? luminance(light) : 0.0;
            sum += value > 0.0 ? high * wide * value : 0.0;
        }
    }
    vec2 area = end - first;
    nits[texel.y * SIDE + texel.x] = sum / (area.x * area.y) / exposure();
}
