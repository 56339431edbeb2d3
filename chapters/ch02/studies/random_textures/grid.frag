// Study random-textures, fragments: a number by lot, and the texture that has it.

#include "palette.glsl"

#if BACKEND_VULKAN
// Flat textures and volumes share one array of descriptors: `textures_2d` and `textures_3d` lie at the same binding.
#include "scene/textures/bindless.glsl"

#if NONUNIFORM
#define SLOT(number) nonuniformEXT(1u + (number))
#else
#define SLOT(number) (1u + (number))
#endif

vec4 flat_texel(uint number, vec2 uv) {
    return textureLod(textures_2d[SLOT(number)], uv, 0.0);
}

vec4 volume_texel(uint number, vec3 at) {
    return textureLod(textures_3d[SLOT(number)], at, 0.0);
}
#else
// A layer is a coordinate, and may differ from pixel to pixel; volumes have no layers, and so lie stacked in one.
layout(BIND(0, 1, 0)) uniform sampler2DArray layers;
layout(BIND(0, 2, 1)) uniform sampler3D stack;

vec4 flat_texel(uint number, vec2 uv) {
    return textureLod(layers, vec3(uv, float(number)), 0.0);
}

vec4 volume_texel(uint number, vec3 at) {
    return textureLod(stack, vec3(at.xy, (float(number - TEXTURES) + at.z) / float(VOLUMES)), 0.0);
}
#endif

layout(location = 0) flat in uint in_triangle;
layout(location = 0) out vec4 out_color;

void main() {
    uvec2 pixel = uvec2(gl_FragCoord.xy);
#if PER_TRIANGLE
    uint lot = scrambled(in_triangle);
#else
    uint lot = scrambled(pixel.x + scrambled(pixel.y));
#endif
    uint number = lot % (TEXTURES + VOLUMES);
    vec3 at = (vec3(pixel % SIDE, (lot >> 8) % SIDE) + 0.5) / float(SIDE);
    out_color = number < TEXTURES ? flat_texel(number, at.xy) : volume_texel(number, at);
}
