// Rays against boxes, which are never missed where a triangle inside is hit by `hits_triangle` of watertight.glsl.
//
// The test of triangles has errors of its own. With u = 2^-24, a corner p relative to the origin, and S = d_x / d_z along
// the largest part z of the direction, so that |S| <= 1: p_x - S p_z has u |p_x| and u |p_z| from the differences, 5 u |p_z|
// from the quotient (2.5 units in the last place, which is what Vulkan asks for; u where division is rounded well), u |p_z|
// from the product, and u (|p_x| + |p_z|) from the last difference. So the triangle that is tested is off by at most
// u (2 |p_x| + 8 |p_z|) from the one in the box. The box is widened by 12 u (|p_x| + |p_z|) for the farthest corners of all
// boxes, of which the rounding of that sum is a part. Where the ray that meets triangles is another one than this, more or
// less, the 12 roundings become more.
//
// Each t of a plane has a difference, a quotient and a product: a relative error of gamma(7) = 7 u / (1 - 7 u). So the
// farther one is enlarged by 1 + 2 gamma(7) (Ize 2013, "Robust BVH Ray Traversal", where division has one rounding and it is
// gamma(3)).

const float SLAB_FAR = 1.0 + 16.0 / 16777216.0;  // two of these are for the roundings of itself

struct SlabRay {
    vec3 inverse;    // of the direction, never infinite
    vec3 low;        // to be subtracted from the low planes of boxes, and from the high ones: the origin, moved outwards
    vec3 high;
    bvec3 negative;  // along which axes the ray comes from the high plane
};

// `centre` and `extent` (half edges) are of a box around all boxes that will be tested.
//
// A part of the direction that is 0, or below 2^-60 of the largest, becomes that: it moves the ray by less than 2^-60 of
// its length, far less than boxes are widened, and no product of 0 and infinity occurs.
SlabRay slab_ray(vec3 origin, vec3 direction, vec3 centre, vec3 extent, float roundings) {
    vec3 size = abs(direction);
    float largest = max(size.x, max(size.y, size.z));
    vec3 least = vec3(largest * 8.673617379884035e-19);
    vec3 safe = mix(max(size, least), -max(size, least), lessThan(direction, vec3(0.0)));
    vec3 reach = abs(centre - origin) + extent;
    float along = size.x >= largest ? reach.x : size.y >= largest ? reach.y : reach.z;
    // The origin itself is rounded when it is moved.
    vec3 pad = (roundings * (reach + along) + 2.0 * abs(origin)) / 16777216.0;
    return SlabRay(1.0 / safe, origin + pad, origin - pad, lessThan(direction, vec3(0.0)));
}

// Returns where the ray enters and leaves the box; it misses the box if the first is larger than the second. Boxes inside
// out are missed by every ray. Both are cut to t_min..t_max.
vec2 slab_interval(SlabRay ray, vec3 low, vec3 high, float t_min, float t_max) {
    vec3 to_low = (low - ray.low) * ray.inverse, to_high = (high - ray.high) * ray.inverse;
    vec3 enter = mix(to_low, to_high, ray.negative), leave = mix(to_high, to_low, ray.negative);
    return vec2(
        max(max(enter.x, enter.y), max(enter.z, t_min)),
        min(min(leave.x, leave.y) * SLAB_FAR, min(leave.z * SLAB_FAR, t_max))
    );
}
