// What the overlay reads: set 3, and no set of the scene, since it needs two views. TESTED: kernels run, so there are
// flags.

#include "masks.glsl"

struct Constants {
#include "frame_constants.glsl"
};
layout(BIND(3, 0, 0), std140) uniform Frame_ { Constants frame; };  // of the camera that draws
layout(BIND(3, 1, 1), std140) uniform View_ { Constants view; };    // of culling: another one while it is frozen

struct Instance {
#include "instance.glsl"
};
layout(BIND(3, 2, 0), std430) readonly buffer Instances_ { Instance instances[]; };
#ifdef INSTANCES_PER_PAGE
layout(BIND(3, 6, 12), std430) readonly buffer More_instances_ { Instance more_instances[]; };
#endif
#include "scene/instance_of.glsl"

layout(BIND(3, 3, 5), std430) readonly buffer Visible_ {
    uint visible[];  // a word for each instance, odd if the frame sees it
};
layout(BIND(3, 4, 6), std430) readonly buffer Pyramid_ { float pyramid[]; };

struct Sphere {
    vec4 sphere;  // middle of the meshlet's box in object space, radius
    vec3 extent;
    uint cone;
    uint instance;
    uint flags;  // of its draw
    uvec2 unused;
};
layout(BIND(3, 5, 7), std430) readonly buffer Spheres_ { Sphere spheres[]; };

// Colours are codes, as under a view. The target of the picture holds light, which is coded later.
#ifdef LIGHT
#include "srgb.glsl"
vec3 stored(vec3 code) { return linear_from_srgb(code); }
#else
vec3 stored(vec3 code) { return code; }
#endif
