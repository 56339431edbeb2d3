// Contact: a particle inside of a collider is moved to its surface and loses its velocity into the surface. Friction
// (Coulomb) takes at most `friction` times that loss from its velocity along the surface.
//
// Velocities are relative to the surface, which may move. So a particle takes over the velocity of a collider, fully
// towards the particle, and along the surface as far as friction allows.

struct Collider {
    vec4 rows[3];     // xyz: one axis of the collider, w: one coordinate of its centre
    vec4 size;        // xyz: half a box, or x: radius; w: 0 sphere, 1 plane, 2 box
    vec4 velocity;    // xyz: of its centre, when these steps are over; w: 1 if it moves
    vec4 spin;        // xyz: radians a second about its centre
};

layout(BIND(0, 2, 2), std430) readonly buffer Colliders_ { Collider colliders[]; };

// Returns the depth of q below the surface of a collider at the origin (negative outside), and the direction outward.
float depth_below(vec3 q, vec4 size, out vec3 outward) {
    outward = vec3(0.0, 1.0, 0.0);
    if (size.w == 1.0) {
        return -q.y;
    }
    if (size.w == 0.0) {
        precise float squared = dot3(q, q);
        float away = sqrt(squared);
        if (squared > TINY) {
            outward = q / away;
        }
        precise float depth = size.x - away;
        return depth;
    }
    precise vec3 over = abs(q) - size.xyz;
    vec3 side = vec3(q.x < 0.0 ? -1.0 : 1.0, q.y < 0.0 ? -1.0 : 1.0, q.z < 0.0 ? -1.0 : 1.0);
    vec3 outside = max(over, vec3(0.0));
    precise float squared = dot3(outside, outside);
    if (squared > TINY) {
        float away = sqrt(squared);
        outward = side * outside / away;
        return -away;
    }
    if (over.x >= over.y && over.x >= over.z) {
        outward = vec3(side.x, 0.0, 0.0);
        return -over.x;
    }
    if (over.y >= over.z) {
        outward = vec3(0.0, side.y, 0.0);
        return -over.y;
    }
    outward = vec3(0.0, 0.0, side.z);
    return -over.z;
}

// Returns an axis `left` seconds earlier, to the second order in the angle.
vec3 turned_back(vec3 axis, vec3 spin, float left) {
    vec3 once = cross3(spin, axis);
    vec3 twice = cross3(spin, once);
    precise vec3 before = axis - left * (once - (0.5 * left) * twice);
    return before;
}

// Moves a particle out of all colliders of its cloth (`own`: first and count), in their order. In h seconds it went from
// `from` to p, and has the velocity v. Colliders are at their places `left` seconds before the end of these steps.
void keep_out(uvec2 own, vec4 skin, float left, float h, vec3 from, inout vec3 p, inout vec3 v) {
    float thickness = skin.x;
    float friction = skin.y;
    for (uint k = own.x; k < own.x + own.y; ++k) {
        vec4 x = colliders[k].rows[0];
        vec4 y = colliders[k].rows[1];
        vec4 z = colliders[k].rows[2];
        vec3 centre = vec3(x.w, y.w, z.w);
        vec4 motion = colliders[k].velocity;
        vec3 velocity = motion.xyz;
        vec3 spin = colliders[k].spin.xyz;
        bool moves = motion.w != 0.0;
        if (moves) {
            precise vec3 was = centre - left * velocity;
            centre = was;
            x.xyz = turned_back(x.xyz, spin, left);
            y.xyz = turned_back(y.xyz, spin, left);
            z.xyz = turned_back(z.xyz, spin, left);
        }
        precise vec3 away = p - centre;
        vec3 q = vec3(dot3(x.xyz, away), dot3(y.xyz, away), dot3(z.xyz, away));
        vec3 outward;
        precise float depth = depth_below(q, colliders[k].size, outward) + thickness;
        if (!(depth > 0.0)) {
            continue;
        }
        precise vec3 n = outward.x * x.xyz + outward.y * y.xyz + outward.z * z.xyz;
        precise vec3 moved = (p + depth * n) - from;
        precise vec3 carried = vec3(0.0);  // motion of the surface in h seconds
        precise vec3 surface = vec3(0.0);  // and its velocity now
        if (moves) {
            precise vec3 middle = away - 0.5 * ((p - from) - h * velocity);
            carried = h * (velocity + cross3(spin, middle));
            surface = velocity + cross3(spin, away);
            moved -= carried;
        }
        precise vec3 slid = moved - dot3(moved, n) * n;
        float path = sqrt(dot3(slid, slid));
        // Friction also undoes a part of the path: otherwise cloth would creep without a velocity.
        precise float kept = friction * depth;
        float part = kept >= path ? 1.0 : kept / path;
        precise vec3 put = (p + depth * n) - part * slid;
        p = put;
        precise vec3 against = moves ? v - surface : v;
        float along = dot3(against, n);
        if (along < 0.0) {
            precise vec3 tangential = against - along * n;
            float speed = sqrt(dot3(tangential, tangential));
            precise float lost = friction * -along;
            precise float kept_part = lost >= speed ? 0.0 : 1.0 - lost / speed;
            precise vec3 slower = tangential * kept_part;
            precise vec3 with_it = slower + surface;
            v = moves ? with_it : slower;
        }
    }
}
