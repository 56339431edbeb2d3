// Study phase-functions: the function at each node and for each g, three times: at the node's 1 - cos, and between two
// directions in the stable and in the usual form.

#include "phase.glsl"
#include "asked.glsl"

layout(local_size_x = 64) in;

layout(BIND(0, 0, 0), std430) readonly buffer Given_ { vec4 given[]; };
layout(BIND(0, 1, 1), std430) writeonly buffer Values_ { vec4 values[]; };

// As it is printed in books.
float usual(float cosine, float g) {
    float d = 1.0 + g * g - 2.0 * g * cosine;
    return (1.0 - g * g) / (12.566370614 * d * sqrt(d));
}

void main() {
    uint point = gl_GlobalInvocationID.x, lobe = gl_GlobalInvocationID.y;
    vec3 arriving = asked.arriving.xyz, leaving = given[point].xyz;
    float g = g_of(lobe);
    float at_node = henyey_greenstein(given[point].w, g);
    float stable = henyey_greenstein(one_minus_cosine(arriving, leaving), g);
    values[lobe * POINTS + point] = vec4(at_node, stable, usual(dot(arriving, leaving), g), 0.0);
}
