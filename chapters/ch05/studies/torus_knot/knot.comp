// Study torus-knot, the kernel: a vertex for each invocation, between two knots. `knot.py` is the same on the CPU.

#include "vertex.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 grid;   // vertices along and around
    uvec4 knots;  // P and Q of both
    vec4 morph;
};
PUSH(Push, push)

layout(BIND(0, 0, 0), std430) writeonly buffer Vertices_ {
    Vertex vertices[];
};

const float TAU = 6.28318530717958647692;
const float RING = 5.0, HOLE = 3.0, TUBE = 0.5;

// Returns the angle after `step` of the `steps` steps of `times` turns. Whole turns are removed as integers: the last point
// is the first one to the bit, and sines have no large arguments, where they are least precise.
float angle(uint times, uint step, uint steps) {
    uint rest = times * step % steps;
    return TAU * (float(rest) / float(steps));
}

vec3 unit(vec3 v) {
    precise float square = v.x * v.x + v.y * v.y + v.z * v.z;
    precise vec3 result = v / sqrt(square);
    return result;
}

vec3 across(vec3 a, vec3 b) {
    precise vec3 result = vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    return result;
}

void tube(uint p, uint q, uint i, float v, out vec3 position, out vec3 normal) {
    float t = angle(p, i, push.grid.x - 1u), s = angle(q, i, push.grid.x - 1u), ratio = float(q) / float(p);
    float ct = cos(t), st = sin(t), cs = cos(s), ss = sin(s), cv = cos(v), sv = sin(v);
    precise float away = RING + HOLE * cs, inward = -ratio * HOLE * ss, upward = ratio * HOLE * cs;
    precise vec3 point = vec3(away * ct, away * st, HOLE * ss);
    precise vec3 along = vec3(inward * ct - away * st, inward * st + away * ct, upward);
    vec3 one = unit(across(point, along));
    vec3 other = unit(across(one, along));
    precise vec3 outward = one * sv + other * cv;
    precise vec3 surface = point + TUBE * outward;
    position = surface;
    normal = outward;
}

void main() {
    uint i = gl_GlobalInvocationID.x, j = gl_GlobalInvocationID.y;
    if (i >= push.grid.x || j >= push.grid.y) {
        return;
    }
    float v = angle(1u, j, push.grid.y - 1u), morph = push.morph.x;
    vec3 first, second, first_normal, second_normal;
    tube(push.knots.x, push.knots.y, i, v, first, first_normal);
    tube(push.knots.z, push.knots.w, i, v, second, second_normal);
    precise vec3 position = first * (1.0 - morph) + second * morph;
    precise vec3 mixed = first_normal * (1.0 - morph) + second_normal * morph;
    vec3 normal = unit(dot(mixed, mixed) < 1e-12 ? first_normal : mixed);
    vec2 place = vec2(i, j) / vec2(push.grid.xy - 1u);
    // A row has the vertices around the knot, whatever the number of rows.
    vertices[i * push.grid.y + j] = Vertex(vec4(position, place.x), vec4(normal, place.y));
}
