// Directions of an environment: to and from the picture of a panorama, and the faces of a cube map.
//
// The world is right-handed with y up. The middle of a panorama is seen along -z, where a camera looks that was not
// turned; u grows to the right, v down from the zenith. `common/environment/directions.py` has the same functions in float64.

const float TURN = 6.28318530717959;

// Where a panorama (twice as wide as high) shows direction `d` of any length: uv from 0 to 1.
vec2 panorama_uv(vec3 d) {
    // The angle from the zenith by its tangent: near the poles its cosine has no digits left.
    float aside = length(d.xz);
    float u = aside > 0.0 ? 0.5 + atan(d.x, -d.z) / TURN : 0.5;  // straight up and down every u is the same point
    return vec2(u, atan(aside, d.y) * (2.0 / TURN));
}

// The unit direction that a panorama shows at `uv`.
vec3 panorama_direction(vec2 uv) {
    float azimuth = (uv.x - 0.5) * TURN;
    float polar = uv.y * (0.5 * TURN);
    return vec3(sin(polar) * sin(azimuth), cos(polar), -sin(polar) * cos(azimuth));
}

// The direction through `uv` (0 to 1, row 0 first) of a cube's face, with 1 as its largest coordinate. Faces are in the
// order +x, -x, +y, -y, +z, -z and turned as OpenGL and Vulkan turn them (Vulkan specification, "Cube Map Face Selection").
vec3 cube_direction(uint face, vec2 uv) {
    vec2 p = uv * 2.0 - 1.0;
    switch (face) {
        case 0u: return vec3(1.0, -p.y, -p.x);
        case 1u: return vec3(-1.0, -p.y, p.x);
        case 2u: return vec3(p.x, 1.0, p.y);
        case 3u: return vec3(p.x, -1.0, -p.y);
        case 4u: return vec3(p.x, -p.y, 1.0);
        default: return vec3(-p.x, -p.y, -1.0);
    }
}

// Which face of a cube map direction `d` (not zero) meets, and the uv there.
vec2 cube_uv(vec3 d, out uint face) {
    vec3 size = abs(d);
    vec2 p;
    float major;
    if (size.z >= size.x && size.z >= size.y) {
        face = d.z < 0.0 ? 5u : 4u;
        p = vec2(d.z < 0.0 ? -d.x : d.x, -d.y);
        major = size.z;
    } else if (size.y >= size.x) {
        face = d.y < 0.0 ? 3u : 2u;
        p = vec2(d.x, d.y < 0.0 ? -d.z : d.z);
        major = size.y;
    } else {
        face = d.x < 0.0 ? 1u : 0u;
        p = vec2(d.x < 0.0 ? d.z : -d.z, -d.y);
        major = size.x;
    }
    return p / major * 0.5 + 0.5;
}

// The solid angle of the texel that unit direction `d` meets, of a cube with `size` texels along an edge: its area,
// (2 / size)^2, seen from the distance 1 / m and tilted by the cosine m, with m the largest coordinate of `d`.
float cube_texel_solid_angle(vec3 d, float size) {
    float m = max(abs(d.x), max(abs(d.y), abs(d.z)));
    return 4.0 * m * m * m / (size * size);
}

// `d` as the environment has it when that was turned about +y, counter-clockwise seen from above, by the angle whose
// cosine and sine are given: what the camera sees is the environment at the direction turned back.
vec3 turned_back(vec3 d, vec2 cos_sin) {
    return vec3(cos_sin.x * d.x - cos_sin.y * d.z, d.y, cos_sin.y * d.x + cos_sin.x * d.z);
}
