// Where a ray meets a sphere.

layout(BIND(0, 2, 2), std430) buffer Counts_ { uint counts[]; };  // zero when the frame begins
layout(BIND(0, 3, 3), std430) readonly buffer Spheres_ { vec4 spheres[]; };  // centre and radius

const uint OUTSIDE = 0u, INSIDE = 1u;  // kinds of hits: from where the ray comes

// What a ray has found; t is -1 if that is nothing.
struct Found {
    float t;
    uint sphere;
    uint kind;
};

// Both parameters at which a ray, whose direction has the length 1, meets a sphere; the first one is larger if it does not.
vec2 sphere_interval(vec3 origin, vec3 direction, vec4 sphere) {
    vec3 f = origin - sphere.xyz;
    float b = -dot(f, direction);
#ifdef USUAL
    float inside = b * b - (dot(f, f) - sphere.w * sphere.w);
    return inside < 0.0 ? vec2(1.0, 0.0) : vec2(b - sqrt(inside), b + sqrt(inside));
#else
    vec3 across = f + b * direction;
    float inside = sphere.w * sphere.w - dot(across, across);
    float q = b + (b < 0.0 ? -1.0 : 1.0) * sqrt(max(inside, 0.0));
    float c = (length(f) - sphere.w) * (length(f) + sphere.w);
    float other = q != 0.0 ? c / q : 0.0;
    return inside < 0.0 ? vec2(1.0, 0.0) : vec2(min(q, other), max(q, other));
#endif
}

// The hit that a ray from `t_min` on sees of a sphere: on its outside, or on its inside if it begins there; kind and t.
bool hits_sphere(vec3 origin, vec3 direction, float t_min, vec4 sphere, out float t, out uint kind) {
    vec2 span = sphere_interval(origin, direction, sphere);
    kind = span.x > t_min ? OUTSIDE : INSIDE;
    t = kind == OUTSIDE ? span.x : span.y;
    return span.x <= span.y && t > t_min;
}
