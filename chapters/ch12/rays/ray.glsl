// A ray and what it hits: the same structs for ray-tracing pipelines, ray queries and the traversal in bvh/.

struct Ray {
    vec3 origin;     // relative to the scene's origin
    float t_min;     // hits have t_min < t < t_max, and 0 <= t_min
    vec3 direction;  // of any length but 0: t counts in its units
    float t_max;
};

struct Hit {
    float t;         // t_max of the ray where nothing is hit
    uint instance;   // id of the instance, its place in the scene; NO_HIT where nothing is hit
    uint primitive;  // number of the triangle in its mesh, in the order of the index list
    vec2 at;         // barycentric coordinates of the triangle's second and third corner
    uint flags;      // HIT_*
};

const uint NO_HIT = 0xFFFFFFFFu;
// Which sides of surfaces a ray passes through, if the surface has one side: those of single-sided materials. The bits are those
// of gl_RayFlagsCullBackFacingTrianglesEXT and gl_RayFlagsCullFrontFacingTrianglesEXT.
const uint SKIP_BACKS = 16u, SKIP_FRONTS = 32u;
const uint HIT_BACK = 1u;  // the corners run clockwise as the ray sees them in object space: mirrors change no side
