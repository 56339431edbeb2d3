// The tests of casters against lights: is a box within the reach of a light, and which of its faces can it be drawn to?
//
// Every test that cannot tell says that it is. The tests of a frame are bits of a word: 1 spheres of instances, 2 spheres of
// meshlets, 4 cones of meshlets, 8 faces. Without a test more is drawn, and the maps are the same.

#include "masks.glsl"
#include "culling/records.glsl"
#include "transform.glsl"
#include "bounds.glsl"

#define SHADOW_BLOCK 0
#include "shadows/block.glsl"

layout(local_size_x = 256) in;

#ifdef TESTS_NOTHING  // in a kernel that counts what the others have left
bool tests(uint kind) { return false; }
#else
bool tests(uint kind) { return (uint(shadow_places[1].z) & kind) != 0u; }
#endif

struct Instance {
#include "instance.glsl"
};
layout(BIND(0, 1, 0), std430) readonly buffer Instances_ { Instance instances[]; };
#ifdef INSTANCES_PER_PAGE
layout(BIND(0, 8, 12), std430) readonly buffer More_instances_ { Instance more_instances[]; };
#endif
#include "scene/instance_of.glsl"
layout(BIND(0, 2, 5), std430) readonly buffer Draws_ { Draw draws[]; };
layout(BIND(0, 3, 6), std430) readonly buffer Batches_ {
    uvec4 batches[];  // first draw, first place, places
};
layout(BIND(0, 4, 7), std430) readonly buffer Meshlets_ { Meshlet meshlets[]; };
layout(BIND(0, 5, 8), std430) buffer Lists_ {
    uvec2 lists[];  // for each light of the round: a draw, and its unit with a bit for each face from bit 24 on
};
layout(BIND(0, 6, 9), std430) buffer Numbers_ {
    uint numbers[];  // of commands, for each face and batch; then of units, for each light and batch
};
layout(BIND(0, 7, 10), std430) buffer Commands_ { uint commands[]; };  // 5 words each

struct Round {
    uvec4 first;  // x: the first layer and list, z: places of a face, w: layers
    uvec4 sizes;  // x: draws, y: batches, z: 1 for movers, 0 for all other casters
};
PUSH(Round, pushed)

const uint ALL_FACES = 63u;

struct Caster {
    vec3 centre;  // of its box in the world, relative to the scene's origin
    vec3 extent;  // half the edges
    float radius;
};

uint draws_end(uint batch) { return batch + 1u < pushed.sizes.y ? batches[batch + 1u].x : pushed.sizes.x; }
uint place_of(uint number, uint batch) { return number * pushed.first.z + batches[batch].y; }
uint commands_number(uint layer, uint batch) { return layer * pushed.sizes.y + batch; }
uint units_number(uint list, uint batch) { return (pushed.first.w + list) * pushed.sizes.y + batch; }

// How far a vertex may be from where it belongs, in metres: sums in float32 of coordinates of this size.
float rounding_of(ShadowFace face, Caster caster) {
    return 4e-6 * dot(abs(caster.centre) + caster.extent + abs(face.origin.xyz), vec3(1.0));
}

// Whether a box is outside of a plane through the origin of a face, with all of its corners.
bool beyond(vec3 inwards, vec3 centre, vec3 extent, float rounding) {
    return dot(inwards, centre) + dot(abs(inwards), extent) < -rounding * dot(abs(inwards), vec3(1.0));
}

bool is_in_face(ShadowFace face, Caster caster) {
    float rounding = rounding_of(face, caster);
    vec3 p = in_face(face, caster.centre), e = caster.extent + rounding;
    vec3 half_size = vec3(
        dot(abs(face.right.xyz), e), dot(abs(face.down.xyz), e), dot(abs(face.ahead.xyz), e)
    );
    vec2 widest = 0.5 * float(face.place.z) / vec2(face.right.w, face.down.w);
    if (p.z + half_size.z < face.origin.w || p.z - half_size.z > face.ends.x) {
        return false;
    }
    if (face.ahead.w == 0.0) {
        return !any(greaterThan(abs(p.xy), widest + half_size.xy));
    }
    vec3 centre = caster.centre - face.origin.xyz, x = face.ahead.xyz * widest.x, y = face.ahead.xyz * widest.y;
    return !(beyond(x - face.right.xyz, centre, e, rounding) || beyond(x + face.right.xyz, centre, e, rounding)
             || beyond(y - face.down.xyz, centre, e, rounding) || beyond(y + face.down.xyz, centre, e, rounding));
}

// Whether the sphere of a caster reaches into that of a light.
bool is_in_reach(ShadowFace face, Caster caster) {
    float reach = face.ends.x + caster.radius + rounding_of(face, caster);
    vec3 away = caster.centre - face.origin.xyz;
    return face.ahead.w == 0.0 || !(dot(away, away) > reach * reach);
}

// A bit for each face of a light that a caster may be drawn to; `base` is the first face, of `count`.
uint faces_of(uint base, uint count, Caster caster) {
    if (!tests(8u)) {
        return (1u << count) - 1u;
    }
    uint mask = 0u;
    for (uint face = 0u; face < count; ++face) {
        mask |= is_in_face(shadow_faces[base + face], caster) ? 1u << face : 0u;
    }
    return mask;
}
