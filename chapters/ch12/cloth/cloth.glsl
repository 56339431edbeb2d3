// Input and arithmetic of all kernels of the cloth simulation; the arithmetic gives the same bits in each.
//
// All cloths of a scene lie in one set of buffers (cloth/layout.py), each with its own run of particles. Vectors are
// three floats in a row: a vec3[] would have a stride of 16 bytes. `precise` forbids fused multiply-adds, which a compiler
// may use in one kernel and not in another. dot and cross are written out, since GLSL does not define their order.

struct ClothRecord {
    uvec2 particles;  // first and count
    uvec2 vertices;   // first and count
    uvec4 streams;    // words in the page: positions, normals, tangents
    vec4 skin;        // x: least distance from colliders in metres, y: friction
};

struct ClothFrame {
    uvec4 run;        // steps, flags, first collider, count
    vec4 factors;     // part of a velocity after damping for h, for h/2; air density * drag coefficient / 12; seconds
    vec4 before[3];   // motion of the node from rest to the begin of these steps
    vec4 after[3];    // and to their end
};

layout(BIND(0, 0, 0), std430) readonly buffer Table_ {
    uvec4 counts;     // cloths, particles, springs, colours
    uvec4 places;     // in `incidence`: springs by particle, triangles' starts, triangles by particle, colours
    uvec4 surface_places;
    ClothRecord cloths[];
};

layout(BIND(0, 1, 1), std430) readonly buffer Frame_ {
    vec4 gravity;
    vec4 wind;
    vec4 times;       // h, 1/h, h/2, 1/h^2
    uvec4 cut;        // substeps, iterations, 1: verlet, 1: XPBD
    ClothFrame frames[];
};

#define LOAD3(array, i) vec3(array[3u * (i)], array[3u * (i) + 1u], array[3u * (i) + 2u])
#define STORE3(array, i, v) { array[3u * (i)] = (v).x; array[3u * (i) + 1u] = (v).y; array[3u * (i) + 2u] = (v).z; }

const float TINY = 1e-30;  // squares of lengths and areas below this have no direction

float dot3(vec3 a, vec3 b) {
    precise float sum = a.x * b.x + a.y * b.y + a.z * b.z;
    return sum;
}

vec3 cross3(vec3 a, vec3 b) {
    precise vec3 product = vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    return product;
}

// Returns the cloth of particle i.
uint cloth_of(uint i) {
    uint low = 0u;
    uint high = counts.x;
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        if (cloths[middle].particles.x <= i) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}
