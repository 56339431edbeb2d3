// Study far-march: the medium, the light in it, and rays.

#include "medium.glsl"
#include "phase.glsl"
#include "slices.glsl"

layout(BIND(0, 0, 0), std140) uniform Air_ {
    mat4 clip_from_view;
    mat4 world_from_view;
    vec4 range;   // x: near, y: log2(far / near), z: far, metres; w: the mean cosine of the phase function
    vec4 size;    // froxels: x, y, z; w: steps of the march
    vec4 medium;  // x: constant, y: height fog's extinction up to the base per metre; z: the base, w: falloff per metre
    vec4 sun;     // xyz: direction to it, w: albedo of the medium
    vec4 lit;     // rgb: the sun's illuminance; w: depth of all that is seen, or 0
    vec4 sky;     // rgb: its luminance; w: 1 if there is a march
    vec4 target;  // xy: pixels; z: the depth of the sky
} air;

float extinction_at(float y) { return air.medium.x + air.medium.y * height_density(y, air.medium.z, air.medium.w); }

float mean_extinction(float y0, float y1) {
    return air.medium.x + air.medium.y * height_mean(y0, y1, air.medium.z, air.medium.w);
}

// What height fog leaves of the sun: its integral from a height up to infinity, over the sine of the elevation.
vec3 sun_at(float y) {
    float below = max(air.medium.z - y, 0.0);
    float thickness = below + height_density(y, air.medium.z, air.medium.w) / air.medium.w;
    return air.lit.rgb * exp(-air.medium.y * thickness / air.sun.y);
}

// Light that goes to the eye at a height, for each unit of extinction; `leaving` is the direction to the eye.
vec3 light_at(float y, vec3 leaving) {
    float phase = henyey_greenstein(one_minus_cosine(-air.sun.xyz, leaving), air.range.w);
    return air.sun.w * (phase * sun_at(y) + air.sky.rgb);
}

struct Ray {
    vec3 start;    // at depth 0
    vec3 way;      // for a metre of depth
    float stretch; // its length
    vec3 leaving;  // the direction to the eye
};

Ray ray_through(vec2 uv) {
    mat3 turn = mat3(air.world_from_view);
    vec3 start = view_from_volume(uv, 0.0, air.clip_from_view);
    vec3 way = view_from_volume(uv, 1.0, air.clip_from_view) - start;
    float stretch = length(way);
    return Ray(turn * start + air.world_from_view[3].xyz, turn * way, stretch, turn * (way / -stretch));
}

// The place of a froxel's record.
uint record_at(uvec3 froxel) {
    uvec3 size = uvec3(air.size.xyz);
    return 2u * ((froxel.z * size.y + froxel.y) * size.x + froxel.x);
}
