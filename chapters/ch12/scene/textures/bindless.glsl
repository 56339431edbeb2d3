// The one set that holds every texture. GLSL has a type per dimension and kind of texel, but a descriptor has not: arrays
// of several types lie at the same binding, and each stored number belongs to one of them.
//
// The index of a descriptor must be the same for all invocations of a draw unless it is marked `nonuniformEXT`.

layout(BIND(2, 10, 0)) uniform sampler2D textures_2d[];
layout(BIND(2, 10, 0)) uniform sampler3D textures_3d[];
layout(BIND(2, 10, 0)) uniform usampler2D textures_uint[];
layout(BIND(2, 11, 0)) uniform writeonly image2D images[];

// Access by slot. These functions are also what keeps the arrays open: the compiler gives an array that is only ever
// indexed by constants the length that those need.

uvec4 fetch_uint(uint slot, ivec2 texel) {
    return texelFetch(textures_uint[nonuniformEXT(slot)], texel, 0);
}

vec4 sample_volume(uint slot, vec3 at) {
    return textureLod(textures_3d[nonuniformEXT(slot)], at, 0.0);
}

void store_texel(uint slot, ivec2 texel, vec4 value) {
    imageStore(images[nonuniformEXT(slot)], texel, value);
}
