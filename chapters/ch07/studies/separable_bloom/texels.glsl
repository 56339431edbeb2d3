// Study separable-bloom: two pictures of SIDE x SIDE texels, one to read and one to write.

layout(BIND(0, 0, 0), std430) readonly buffer From_ { vec4 from[]; };
layout(BIND(0, 1, 1), std430) ACCESS buffer To_ { vec4 to[]; };
