// Study types-16bit: push constants and the four buffers, in the three ways.

#if WAY == 0
#extension GL_EXT_shader_explicit_arithmetic_types : require
#extension GL_EXT_shader_16bit_storage : require
#define INTEGER int16_t
#define HALF float16_t
#else
#define INTEGER uint  // two numbers if WAY is 1; one number, with its sign extended, if it is 2
#define HALF uint     // the bits of two halves, or of one
#endif

struct Push {
    uvec4 integers;  // a, b, shift, pairs of numbers
    uvec4 halves;    // bits of c, bits of d
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) readonly buffer X_ {
    INTEGER x[];
};
layout(BIND(0, 1, 1), std430) readonly buffer H_ {
    HALF h[];
};
layout(BIND(0, 2, 2), std430) ACCESS buffer Y_ {
    INTEGER y[];
};
layout(BIND(0, 3, 3), std430) ACCESS buffer G_ {
    HALF g[];
};
