// Writes the drawn vertices: place and normal are those of the particle, the tangent comes from the vertex's own triangles.
// Two vertices of a seam share a particle, but not the directions of the texture.
//
// The fourth number of a tangent, the texture's handedness, keeps its loaded value: bending does not change it.

layout(local_size_x = THREADS) in;

struct Push {
    uvec4 run;        // x: first vertex, y: count, of cloths in this page
};
PUSH(Push, push)

#include "cloth.glsl"
#include "direction.glsl"

layout(BIND(0, 2, 2), std430) readonly buffer Positions_ { float positions[]; };
layout(BIND(0, 3, 3), std430) readonly buffer Normals_ { float normals[]; };
layout(BIND(0, 4, 4), std430) readonly buffer Triangles_ { uint triangles[]; };
layout(BIND(0, 5, 5), std430) readonly buffer Surface_ { uint surface[]; };
layout(BIND(0, 6, 6), std430) writeonly buffer Words_ { uint words[]; };

#define STORE_WORDS(at, v) words[at] = floatBitsToUint((v).x); words[(at) + 1u] = floatBitsToUint((v).y); \
    words[(at) + 2u] = floatBitsToUint((v).z)

// Returns the last cloth whose vertices begin at or before v: a cloth without vertices begins where the next one does.
uint cloth_of_vertex(uint v) {
    uint low = 0u;
    uint high = counts.x;
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        if (cloths[middle].vertices.x <= v) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

// Returns the direction along the surface in which u rises, at vertex v with normal n.
vec3 tangent(uint v, vec3 n) {
    precise vec3 sum = vec3(0.0);
    uint last = surface[surface_places.y + v + 1u];
    for (uint entry = surface[surface_places.y + v]; entry < last; ++entry) {
        uint t = surface[surface_places.z + entry];
        vec3 origin = LOAD3(positions, triangles[4u * t]);
        precise vec3 e1 = LOAD3(positions, triangles[4u * t + 1u]) - origin;
        precise vec3 e2 = LOAD3(positions, triangles[4u * t + 2u]) - origin;
        uint factors = surface_places.w + 2u * t;
        sum += uintBitsToFloat(surface[factors]) * e1 + uintBitsToFloat(surface[factors + 1u]) * e2;
    }
    vec3 along = direction(sum, vec3(0.0));
    precise vec3 flat_on = along - dot3(along, n) * n;
    // Without a direction in the texture, any direction in the surface will do.
    vec3 across = cross3(n, abs(n.x) < 0.5 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
    float rest = dot3(flat_on, flat_on);
    return direction(rest > 1e-12 ? flat_on : across, vec3(1.0, 0.0, 0.0));
}

void main() {
    if (gl_GlobalInvocationID.x >= push.run.y) {
        return;
    }
    uint v = push.run.x + gl_GlobalInvocationID.x;
    uint c = cloth_of_vertex(v);
    uint i = surface[surface_places.x + v];
    if ((frames[c].run.y & WRITE) == 0u || i == NOWHERE) {
        return;
    }
    uint own = v - cloths[c].vertices.x;
    uvec4 streams = cloths[c].streams;
    vec3 place = LOAD3(positions, i);
    vec3 n = LOAD3(normals, i);
    STORE_WORDS(streams.x + 3u * own, place);
    if (streams.y != NOWHERE) {
        STORE_WORDS(streams.y + 3u * own, n);
    }
    if (streams.z != NOWHERE) {
        vec3 t = tangent(v, n);
        STORE_WORDS(streams.z + 4u * own, t);
    }
}
