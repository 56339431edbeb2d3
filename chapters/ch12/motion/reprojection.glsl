// The motion of a point from its clip coordinates now and in the frame before, both without jitter.
//
// All of it is `precise`: equal coordinates give equal quotients, and their difference is exactly zero. Some compilers
// otherwise turn one of two equal divisions into a product with a reciprocal.

#include "half.glsl"

const float FARTHEST = 64.0;  // see motion/model.py

// Arguments are x, y and w of clip coordinates. Returns current minus previous position in uv units.
vec2 motion_between(vec3 now, vec3 before) {
    // Behind the camera, or so close to its plane that the quotient may overflow, a point was outside of the picture.
    if (!(before.z > 1e-6 * now.z)) {
        return vec2(FARTHEST);
    }
    precise vec2 here = now.xy / now.z;
    precise vec2 there = before.xy / before.z;
    precise vec2 moved = 0.5 * (here - there);
    // A target that cuts halves off would make all vectors too short.
    vec2 size = nearest_half(vec3(min(abs(moved), FARTHEST), 0.0)).xy;
    return mix(size, -size, lessThan(moved, vec2(0.0)));
}
