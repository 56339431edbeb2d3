// What the kernels of the light lists share: the scene, the buffer that they write, and the constants of its layout.

#define LISTS_WRITTEN
#include "scene/scene.glsl"
#include "clusters/layout.glsl"

struct Layout {
    uvec4 header;  // the words with which the header begins
};
PUSH(Layout, pushed)

struct Bound {
    vec3 direction;      // towards the middle of the sphere; of an orthographic view its x and y, in metres
    vec2 angle;          // cosine and sine of its half angle in the picture; of an orthographic view x: its radius
    vec2 interval;       // depths ahead of the eye between which the light gives anything
    uint code;           // the middle of the interval, as an integer in the same order
};

uint local_lights() { return light_count.x - light_count.y; }

void store_bound(uint at, Bound bound) {
    light_lists[at] = floatBitsToUint(bound.direction.x);
    light_lists[at + 1u] = floatBitsToUint(bound.direction.y);
    light_lists[at + 2u] = floatBitsToUint(bound.direction.z);
    light_lists[at + 3u] = floatBitsToUint(bound.angle.x);
    light_lists[at + 4u] = floatBitsToUint(bound.angle.y);
    light_lists[at + 5u] = floatBitsToUint(bound.interval.x);
    light_lists[at + 6u] = floatBitsToUint(bound.interval.y);
    light_lists[at + 7u] = bound.code;
}

vec2 interval_at(uint at) {
    return uintBitsToFloat(uvec2(light_lists[at + 5u], light_lists[at + 6u]));
}
