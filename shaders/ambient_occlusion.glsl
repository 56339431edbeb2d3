// Ambient occlusion in screen space: what one sample hides, the directions of the samples, and how the result dims light.
//
// Two estimates. "Depth" looks at eight surfaces around a point and asks of each only how much nearer to the eye it is.
// "Normals" follows rays of a hemisphere around the point's normal and asks whether they end behind a surface.

const float GOLDEN_TURN = 2.3999632;  // radians: pi (3 - sqrt(5))

// --- the pattern of 4x4 pixels ---

// The number 0 to 15 of a pixel in its block of 4x4, in the order of a Bayer matrix: any block of 4x4 pixels has all
// sixteen, and neighbours have numbers that are far apart.
uint pattern_index(uvec2 pixel) {
    uint x = pixel.x & 3u, y = pixel.y & 3u, d = x ^ y;
    return (d & 1u) << 3 | (y & 1u) << 2 | (d & 2u) | y >> 1;
}

// One of sixteen unit vectors, spread over the sphere: equal steps of z, and the golden angle around it.
vec3 rotation_vector(uvec2 pixel) {
    float index = float(pattern_index(pixel));
    float z = 1.0 - (2.0 * index + 1.0) / 16.0;
    float around = sqrt(1.0 - z * z), turn = GOLDEN_TURN * index;
    return vec3(around * cos(turn), around * sin(turn), z);
}

// --- "depth" ---

// Offset `index` of eight: a corner of the cube from -0.5 to 0.5, reflected about the plane with the unit normal `about`,
// which keeps its length of sqrt(0.75).
vec3 sample_offset(uint index, vec3 about) {
    vec3 corner = vec3(index & 1u, index >> 1 & 1u, index >> 2 & 1u) - 0.5;
    return reflect(corner, about);
}

// How much light passes a surface that is nearer to the eye than the point by `nearer` radii: least at one radius, and
// all of it from two on, where the surface stands apart. The same surface, or one behind it, hides nothing.
float sample_visibility(float nearer) {
    float least = max(nearer, 0.0);
    float occlusion = 15.0 * max(least * (2.0 - least), 0.0);
    return 1.0 / (1.0 + occlusion * occlusion);
}

// The visibility of a point from the sum over eight samples. A surface in a corner of convex things hides half of its
// surroundings and is lit in full: 1 up to two hidden samples. Eight leave 0.45.
float visibility_of_sum(float sum) {
    return clamp(sum * sum / 64.0 + 0.45, 0.0, 1.0);
}

// --- "normals" ---

// Ray `index` of eight around +z, distributed as the cosine to it, so that each counts alike: a point of the unit disc
// from rings of equal area, lifted to the hemisphere (Malley's method). `turn` rotates all of them.
vec3 hemisphere_direction(uint index, float turn) {
    float part = (float(index) + 0.5) / 8.0, angle = GOLDEN_TURN * float(index) + turn;
    return vec3(sqrt(part) * cos(angle), sqrt(part) * sin(angle), sqrt(1.0 - part));
}

// `direction` in a frame whose z is the unit vector `n` (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
vec3 around_normal(vec3 direction, vec3 n) {
    float s = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z), b = n.x * n.y * a;
    vec3 tangent = vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x);
    vec3 bitangent = vec3(b, s + n.y * n.y * a, -n.y);
    return tangent * direction.x + bitangent * direction.y + n * direction.z;
}

// Whether the surface at `seen` hides a point of a ray that lies `behind` it, as seen from the eye; lengths in radii. What
// is farther in front than the radius stands apart. What does not rise above the plane of the ray's origin, beyond the
// rounding of a stored normal, is a part of this plane. `offset` is from the origin of the ray to the surface.
bool hides(float behind, vec3 offset, vec3 n) {
    float above = dot(offset, n);
    return behind > 0.0 && behind < 1.0 && above > 0.0 && above * above > 0.0025 * dot(offset, offset);
}

// --- blur ---

// Weight of the tap `offset` texels away, -5 to 5, of 133 together: about a Gaussian of sigma 2.26.
float blur_weight(int offset) {
    const float WEIGHTS[6] = float[6](25.0, 20.0, 15.0, 10.0, 6.0, 3.0);
    return WEIGHTS[abs(offset)];
}

// Whether two distances are of one surface: 1 if they differ by less than `tolerance`, 0 from its double on.
float same_surface(float distance, float expected, float tolerance) {
    return clamp(2.0 - abs(distance - expected) / tolerance, 0.0, 1.0);
}

// --- combine ---

// The factor on ambient light: the occlusion with a bias, mixed in by `scale`. A scale of 0 gives exactly 1, and so does
// a visibility of 1.
float ambient_factor(float visibility, float bias, float scale) {
    return 1.0 - scale * (1.0 - clamp(visibility + bias, 0.0, 1.0));
}
