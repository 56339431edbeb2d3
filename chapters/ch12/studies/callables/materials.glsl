// Study callables: what comes to a material and what it gives, and the materials.

struct Point {
    vec3 position;  // comes in: metres
    vec3 normal;    // comes in: of the face
    vec3 color;     // goes out: linear, without light
};

// The two coordinates across the normal of a block.
vec2 across(Point at) {
    vec3 n = abs(at.normal);
    return n.x > 0.5 ? at.position.zy : n.y > 0.5 ? at.position.xz : at.position.xy;
}

vec3 checks(Point at) {
    vec2 cell = floor(across(at) * 8.0);
    return mod(cell.x + cell.y, 2.0) < 0.5 ? vec3(0.75, 0.72, 0.65) : vec3(0.12, 0.13, 0.16);
}

vec3 rings(Point at) {
    vec2 away = fract(across(at) * 2.5) - 0.5;
    return fract(length(away) * 5.0) < 0.5 ? vec3(0.65, 0.12, 0.08) : vec3(0.85, 0.75, 0.55);
}

vec3 stripes(Point at) {
    float along = fract((at.position.x + at.position.y + at.position.z) * 5.0);
    return mix(vec3(0.05, 0.2, 0.45), vec3(0.3, 0.65, 0.8), abs(2.0 * along - 1.0));
}

vec3 spots(Point at) {
    vec2 place = across(at) * 9.0;
    vec2 away = fract(place) - 0.5;
    return dot(away, away) < 0.09 ? vec3(0.95, 0.8, 0.1) : vec3(0.1, 0.35, 0.12);
}
