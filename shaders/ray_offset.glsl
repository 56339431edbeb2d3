// Where a ray may begin that leaves a triangle: so far from its plane that no rounding has the ray hit the triangle again,
// and no farther. The distance follows from the corners, so that it holds at any scale and any distance from the origin.
//
// Let u = 2^-24, M the matrix, T its translation, s the largest |corner| by components, and e1, e2 two edges.
//   The point a + x e1 + y e2 in object space is off by u (s + 6 (|e1| + |e2|)): the edges are differences, with one
//   rounding each, and two products and two sums follow; in the world by u (5 (|M| s + |T|) + 6 |M| (|e1| + |e2|)).
//   The next test takes the origin p back to object space, as M^-1 (p - T): u |p| and 5 roundings of |M| |M^-1| |p - T|.
//   For rotations and for scales along the axes of the object, |M| |M^-1| is at most 1 in every entry, and p - T is at
//   most |M| s. Shear adds as its condition grows.
//   The test itself moves corners by 10 u times their distance from the origin (slabs.glsl). Its edge functions are off
//   by 2 u times the square of that, which moves t by as much as another 6 u times the distance over the sine at which the
//   ray leaves. Both together are below 20 u (|e1| + |e2|), and both are lengths along the normal.
// What is added rounds once more. Normals of slivers have errors of their own: this holds to an aspect of 1000.

struct SurfacePoint {
    vec3 position;  // in the world
    vec3 normal;    // of the triangle's plane, on the side from which its corners run counter-clockwise in object space
    float offset;   // along the normal, metres
};

// `at` are the barycentric coordinates of b and c; `world_from_object` has the rows of the matrix as its columns.
SurfacePoint surface_point(mat3x4 world_from_object, vec3 a, vec3 b, vec3 c, vec2 at) {
    mat3 rows = mat3(world_from_object[0].xyz, world_from_object[1].xyz, world_from_object[2].xyz);
    mat3 sizes = mat3(abs(rows[0]), abs(rows[1]), abs(rows[2]));
    vec3 translation = vec3(world_from_object[0].w, world_from_object[1].w, world_from_object[2].w);
    vec3 e1 = b - a, e2 = c - a;
    vec3 position = (a + (at.x * e1 + at.y * e2)) * rows + translation;
    vec3 x = e1 * rows, y = e2 * rows;
    // Lengths are taken out first, so that products of short edges do not become 0.
    float longest = max(max(max(abs(x.x), abs(x.y)), abs(x.z)), max(max(abs(y.x), abs(y.y)), abs(y.z)));
    vec3 normal = cross(x / longest, y / longest);
    normal /= max(length(normal), 1e-30);
    normal = dot(cross(rows[0], rows[1]), rows[2]) < 0.0 ? -normal : normal;
    vec3 placed = max(max(abs(a), abs(b)), abs(c)) * sizes, edges = (abs(e1) + abs(e2)) * sizes;
    float around = 5.0 * dot(placed, vec3(1.0)) + 20.0 * dot(edges, vec3(1.0));
    vec3 error = 7.0 * (placed + abs(translation)) + 6.0 * edges + around;
    return SurfacePoint(position, normal, dot(abs(normal), error) / 16777216.0);
}

// The origin of a ray in `direction`, on that side of the plane to which it leads.
vec3 ray_origin(SurfacePoint point, vec3 direction) {
    return point.position + (dot(point.normal, direction) < 0.0 ? -point.offset : point.offset) * point.normal;
}
