// Vertex pulling: a page of geometry is one array of words, and the shader itself fetches what it needs of a vertex. So one
// buffer serves every mesh and every vertex format, and nothing has to be bound between two draws.

layout(BIND(1, 0, 4), std430) readonly buffer Words_ { uint words[]; };
// Where vertices deform: the page of the other slot, which the frame before has drawn. On Vulkan all shaders declare it, so
// that they share a layout. OpenGL counts a block as used because it is declared, and kernels have other buffers there.
#if defined(PREVIOUS_WORDS) && (BACKEND_VULKAN == 1 || !defined(COMPUTED))
layout(BIND(1, 1, 5), std430) readonly buffer Previous_words_ { uint previous_words[]; };
#endif

vec2 fetch2(uint first, uint vertex) {
    uint at = first + 2u * vertex;
    return uintBitsToFloat(uvec2(words[at], words[at + 1u]));
}

vec3 fetch3(uint first, uint vertex) {
    uint at = first + 3u * vertex;
    return uintBitsToFloat(uvec3(words[at], words[at + 1u], words[at + 2u]));
}

vec4 fetch4(uint first, uint vertex) {
    uint at = first + 4u * vertex;
    return uintBitsToFloat(uvec4(words[at], words[at + 1u], words[at + 2u], words[at + 3u]));
}
