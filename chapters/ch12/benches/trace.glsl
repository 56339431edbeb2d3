// Rays from a buffer, and what each of them hits first; the way that finds hits is chosen by the defines of rays/trace.glsl.

#include "rays/trace.glsl"

struct Job {
    vec4 origin;     // w: t_min
    vec4 direction;  // w: t_max
};
layout(BIND(0, 3, 3), std430) readonly buffer Jobs_ { Job jobs[]; };

struct Found {
    uvec4 what;  // instance, triangle, the bits of t
    vec4 at;     // barycentric coordinates
};
layout(BIND(0, 4, 4), std430) writeonly buffer Found_ { Found found[]; };

struct Push { uvec4 run; };  // x: first ray, y: rays
PUSH(Push, push)

void run(uvec3 id) {
    if (id.x >= push.run.y) {
        return;
    }
    uint i = push.run.x + id.x;
    Job job = jobs[i];
    Hit hit = trace(Ray(job.origin.xyz, job.origin.w, job.direction.xyz, job.direction.w), 0xFFu, 0u);
    found[i] = Found(uvec4(hit.instance, hit.primitive, floatBitsToUint(hit.t), 0u), vec4(hit.at, 0.0, 0.0));
}
