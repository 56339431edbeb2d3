// Study torus-knot: a vertex, as the kernel writes it and the draw reads it.

struct Vertex {
    vec4 position;  // and how far along the knot, from 0 to 1
    vec4 normal;    // and how far around it
};
