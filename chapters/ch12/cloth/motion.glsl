// The stages of a substep, each for one particle or one spring. Within a stage no invocation reads what another one writes:
// new values go to `scratch`, or belong to the particle alone. So the order of invocations does not matter.
//
// Springs (kick-drift-kick): `begin` changes velocities by the forces at the positions, `end` moves particles by their
// velocities. Symplectic Euler kicks by h and drifts; Verlet kicks by h/2, drifts, and kicks by h/2 again.
//
// XPBD (Macklin, Mueller, Chentanez 2016): `begin` moves particles as if there were no springs. `constrain` corrects the
// distance of the two particles of each spring, colour by colour. `end` computes the velocity from the path.
//
// Both methods are in one text, and cut.w selects one: that halves the number of kernels to compile.
//
// Define STATE_ACCESS before this file: the qualifier of the buffers that stages write.

#include "cloth.glsl"
#include "contact.glsl"

layout(BIND(0, 3, 3), std430) STATE_ACCESS buffer Positions_ { float positions[]; };
layout(BIND(0, 4, 4), std430) STATE_ACCESS buffer Velocities_ { float velocities[]; };
layout(BIND(0, 5, 5), std430) STATE_ACCESS buffer Scratch_ { float scratch[]; };
layout(BIND(0, 6, 6), std430) readonly buffer Particles_ { float particles[]; };  // at rest x, y, z; 1 / mass
layout(BIND(0, 7, 7), std430) readonly buffer Springs_ { uint springs[]; };       // two particles
layout(BIND(0, 8, 8), std430) readonly buffer Lengths_ { float lengths[]; };      // at rest, its square; N/m
layout(BIND(0, 9, 9), std430) readonly buffer Incidence_ { uint incidence[]; };
layout(BIND(0, 10, 10), std430) readonly buffer Triangles_ { uint triangles[]; }; // three particles; bits of a third of the mass
layout(BIND(0, 11, 11), std430) STATE_ACCESS buffer Lambdas_ { float lambdas[]; };

// The data of a cloth that its stages need. A kernel reads it once, not in each stage for each particle: a read of shared
// data takes as long as any, and some compilers generate a load for each invocation of a vector.
struct Cloth {
    ClothFrame frame;
    vec4 skin;
};

Cloth read_cloth(uint c) {
    return Cloth(frames[c], cloths[c].skin);
}

// Returns the place of held particle i at `part` of its node's motion during these steps.
vec3 held_at(uint i, Cloth cloth, float part) {
    vec3 rest = vec3(particles[4u * i], particles[4u * i + 1u], particles[4u * i + 2u]);
    vec3 place;
    for (uint k = 0u; k < 3u; ++k) {
        vec4 first = cloth.frame.before[k];
        vec4 last = cloth.frame.after[k];
        precise vec4 row = part == 1.0 ? last : first + (last - first) * part;
        precise float coordinate = row.x * rest.x + row.y * rest.y + row.z * rest.z + row.w;
        place[k] = coordinate;
    }
    return place;
}

// Returns the part of a frame's steps that is over after a substep; exactly 1 after the last.
float part_gone(Cloth cloth, uint step, uint substep) {
    uint done = step * cut.x + substep + 1u;
    uint all = cloth.frame.run.x * cut.x;
    return done == all ? 1.0 : float(done) / float(all);
}

void reset(uint i, Cloth cloth) {
    vec3 place = held_at(i, cloth, 0.0);
    STORE3(positions, i, place);
    STORE3(velocities, i, vec3(0.0));
}

// Returns the change of velocity by the air in w seconds, from the triangles around particle i.
//
// A triangle with the normal velocity u against the air is slowed by k |u| u, k = density * drag * area / (2 mass). After w
// seconds of that u / (1 + k |u| w) is left, which never changes its sign, however light the cloth and strong the wind.
vec3 air_drag(uint i, float air, float inverse_mass, float w) {
    precise vec3 change = vec3(0.0);
    if (air == 0.0) {
        return change;
    }
    uint last = incidence[places.y + i + 1u];
    for (uint entry = incidence[places.y + i]; entry < last; ++entry) {
        uint t = 4u * incidence[places.z + entry];
        uvec3 at = uvec3(triangles[t], triangles[t + 1u], triangles[t + 2u]);
        float third = uintBitsToFloat(triangles[t + 3u]);
        vec3 origin = LOAD3(positions, at.x);
        precise vec3 e1 = LOAD3(positions, at.y) - origin;
        precise vec3 e2 = LOAD3(positions, at.z) - origin;
        vec3 normal = cross3(e1, e2);
        float squared = dot3(normal, normal);
        if (!(squared > TINY && third > 0.0)) {
            continue;
        }
        float twice_area = sqrt(squared);
        precise vec3 n = normal / twice_area;
        precise vec3 mean = (LOAD3(velocities, at.x) + LOAD3(velocities, at.y) + LOAD3(velocities, at.z)) * (1.0 / 3.0);
        precise vec3 against = mean + w * gravity.xyz - wind.xyz;
        float u = dot3(against, n);
        precise float slowed = air * twice_area / third * abs(u) * w;
        precise float lost = u * (slowed / (1.0 + slowed)) * (third * inverse_mass);
        change -= lost * n;
    }
    return change;
}

// Returns the force of all springs on particle i, in newtons.
vec3 pull_of_springs(uint i, vec3 x) {
    precise vec3 force = vec3(0.0);
    uint last = incidence[i + 1u];
    for (uint entry = incidence[i]; entry < last; ++entry) {
        uint s = incidence[places.x + entry];
        uint other = springs[2u * s] == i ? springs[2u * s + 1u] : springs[2u * s];
        precise vec3 apart = LOAD3(positions, other) - x;
        float squared = dot3(apart, apart);
        if (squared > TINY) {
            float distance_now = sqrt(squared);
            // l - rest, without the rounding of l: exactly 0 at rest.
            precise float longer = (squared - lengths[3u * s + 1u]) / (distance_now + lengths[3u * s]);
            precise float pull = lengths[3u * s + 2u] * longer / distance_now;
            force += pull * apart;
        }
    }
    return force;
}

// The first stage writes `scratch`. Springs: the velocity after the forces at this place, for h or half of it. XPBD: the
// next place of the particle without springs. Held particle: its next place.
void begin(uint i, Cloth cloth, uint step, uint substep, bool is_half, bool at_end) {
    float inverse_mass = particles[4u * i + 3u];
    if (inverse_mass == 0.0) {
        if (!at_end) {
            vec3 to = held_at(i, cloth, part_gone(cloth, step, substep));
            STORE3(scratch, i, to);
        }
        return;
    }
    float w = is_half ? times.z : times.x;
    vec3 x = LOAD3(positions, i);
    vec3 force = cut.w != 0u ? vec3(0.0) : pull_of_springs(i, x);
    precise vec3 v = LOAD3(velocities, i) + w * (force * inverse_mass + gravity.xyz);
    v += air_drag(i, cloth.frame.factors.z, inverse_mass, w);
    precise vec3 decayed = v * (is_half ? cloth.frame.factors.y : cloth.frame.factors.x);
    precise vec3 moved = x + w * v;
    vec3 kept = cut.w != 0u ? moved : decayed;
    STORE3(scratch, i, kept);
}

// Moves the two particles of spring s towards its length at rest, as far as its compliance 1/k allows.
void constrain(uint s, uint iteration) {
    uint a = springs[2u * s];
    uint b = springs[2u * s + 1u];
    float wa = particles[4u * a + 3u];
    float wb = particles[4u * b + 3u];
    vec3 pa = LOAD3(scratch, a);
    vec3 pb = LOAD3(scratch, b);
    float multiplier = iteration == 0u ? 0.0 : lambdas[s];
    precise vec3 apart = pb - pa;
    float squared = dot3(apart, apart);
    if (squared > TINY) {
        float distance_now = sqrt(squared);
        precise float longer = (squared - lengths[3u * s + 1u]) / (distance_now + lengths[3u * s]);
        precise float alpha = times.w / lengths[3u * s + 2u];
        precise float change = (-longer - alpha * multiplier) / (wa + wb + alpha);
        precise vec3 n = apart / distance_now;
        precise vec3 to_a = pa - wa * change * n;
        precise vec3 to_b = pb + wb * change * n;
        precise float sum = multiplier + change;
        multiplier = sum;
        STORE3(scratch, a, to_a);
        STORE3(scratch, b, to_b);
    }
    if (cut.y > 1u) {
        lambdas[s] = multiplier;
    }
}

// The last stage moves the particle to its next place, and out of colliders. Springs: `scratch` is the velocity to move by.
// XPBD: `scratch` is the place, and the velocity is the path to it, divided by h.
//
// The half kick at the end of a step of Verlet (`at_end`) moves nothing. It only removes the velocity into a collider: cloth
// that lies on a collider then has no speed, despite its weight.
void end(uint i, Cloth cloth, uint step, uint substep, bool at_end) {
    vec3 from = LOAD3(positions, i);
    vec3 held = LOAD3(scratch, i);
    bool is_free = particles[4u * i + 3u] > 0.0;
    if (at_end && !is_free) {
        return;
    }
    precise vec3 moved = from + (at_end ? times.z : times.x) * held;
    precise vec3 went = (held - from) * times.y;
    bool is_place = cut.w != 0u || !is_free;
    vec3 p = is_place ? held : moved;
    vec3 v = is_place ? went : held;
    if (is_free) {
        // The last half kick looks half a substep ahead, and so do the colliders.
        precise float left = (1.0 - part_gone(cloth, step, substep)) * cloth.frame.factors.w - (at_end ? times.z : 0.0);
        keep_out(cloth.frame.run.zw, cloth.skin, left, at_end ? times.z : times.x, from, p, v);
        precise vec3 decayed = v * cloth.frame.factors.x;
        v = cut.w != 0u ? decayed : v;
    }
    if (!at_end) {
        STORE3(positions, i, p);
    }
    STORE3(velocities, i, v);
}
