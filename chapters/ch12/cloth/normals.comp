// The normal of each particle: the mean of the normals of its triangles, weighted by area. A cross product is twice the area.

layout(local_size_x = THREADS) in;

#include "cloth.glsl"
#include "direction.glsl"

layout(BIND(0, 2, 2), std430) readonly buffer Positions_ { float positions[]; };
layout(BIND(0, 3, 3), std430) writeonly buffer Normals_ { float normals[]; };
layout(BIND(0, 4, 4), std430) readonly buffer Incidence_ { uint incidence[]; };
layout(BIND(0, 5, 5), std430) readonly buffer Triangles_ { uint triangles[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= counts.y || (frames[cloth_of(i)].run.y & WRITE) == 0u) {
        return;
    }
    precise vec3 sum = vec3(0.0);
    uint last = incidence[places.y + i + 1u];
    for (uint entry = incidence[places.y + i]; entry < last; ++entry) {
        uint t = 4u * incidence[places.z + entry];
        vec3 origin = LOAD3(positions, triangles[t]);
        precise vec3 e1 = LOAD3(positions, triangles[t + 1u]) - origin;
        precise vec3 e2 = LOAD3(positions, triangles[t + 2u]) - origin;
        sum += cross3(e1, e2);
    }
    vec3 n = direction(sum, vec3(0.0, 1.0, 0.0));
    STORE3(normals, i, n);
}
