// The tests of culling: whether a sphere or a box is outside of the view, faces away, or which part of the picture and
// of the depth it can cover at most. Reversed Z; clip space is Vulkan's (0 <= z <= w) on both backends.
//
// Every function errs on one side: where it cannot tell, as for NaN, the result is "visible". Compilers may turn
// `!(a < b)` into `a >= b`, and NaN would be on the other side. So the comparisons that decide are made with the bits
// of numbers, which are integers. Below, u = 2^-24 is the error of one rounding.

const float ROUNDINGS = 1e-6;  // 16 u: more than any value here has in roundings of its own

// Whether a number is below 0, and neither NaN nor infinite.
bool is_negative(float value) {
    uint bits = floatBitsToUint(value);
    return bits > 0x80000000u && bits < 0xFF800000u;
}

// Whether all are between -1e18 and 1e18: not NaN, not infinite, and their squares do not overflow either.
bool are_moderate(vec3 values) {
    return all(lessThan(floatBitsToUint(values) & 0x7FFFFFFFu, uvec3(floatBitsToUint(1e18))));
}

// --- what transforms do to a bound ---------------------------------------------------------------------------------

// A bound of |A v| / |v| over all vectors v, for the 3x3 matrix A of `world_from_object` (its columns are the rows).
// The largest eigenvalue of A^T A is at most the largest sum of absolute values in a row (Gershgorin 1931). For a
// rotation times a scale along the axes A^T A is diagonal, and the bound is the largest scale. NaN stays NaN.
float stretch_bound(mat3x4 world_from_object) {
    vec3 row0 = world_from_object[0].xyz, row1 = world_from_object[1].xyz, row2 = world_from_object[2].xyz;
    float size = dot(abs(row0) + abs(row1) + abs(row2), vec3(1.0));
    if (size == 0.0) {
        return 0.0;
    }
    row0 /= size;  // so that no square overflows or vanishes
    row1 /= size;
    row2 /= size;
    vec3 x = vec3(row0.x, row1.x, row2.x), y = vec3(row0.y, row1.y, row2.y), z = vec3(row0.z, row1.z, row2.z);
    float xy = abs(dot(x, y)), xz = abs(dot(x, z)), yz = abs(dot(y, z));
    float square = max(max(dot(x, x) + xy + xz, dot(y, y) + xy + yz), dot(z, z) + xz + yz);
    return size * sqrt(square) * (1.0 + ROUNDINGS);
}

// Vertices are transformed in float32, to the world and then to the view, and far from the origin they do not land
// where the same sums land for the centre of a bound. Each coordinate in the world is a sum of four terms, whose
// errors are at most 4 u times the sum of their absolute values; the length of those sums is at most that of a
// `reach`. This is the reach of an object whose box in object space has this centre and these half edges.
vec3 object_reach(mat3x4 world_from_object, vec3 centre, vec3 extent) {
    vec3 most = abs(centre) + extent;
    return vec3(
        dot(vec4(most, 1.0), abs(world_from_object[0])), dot(vec4(most, 1.0), abs(world_from_object[1])),
        dot(vec4(most, 1.0), abs(world_from_object[2]))
    );
}

// The same from a box in the world, for rotations times scales along the axes: there the sums of absolute values are
// at most sqrt(3) |w - t| + |t| long, for a vertex at w and a translation t.
vec3 world_reach(mat3x4 world_from_object, vec3 centre, vec3 extent) {
    vec3 translation = vec3(world_from_object[0].w, world_from_object[1].w, world_from_object[2].w);
    return 4.0 * (abs(centre) + extent + abs(translation));
}

// The farthest, in metres, that a vertex is in view space from where it belongs, together with the error of the
// centre, the radius and the half axes of its bound. A vertex has 4 u reach from the way to the world, and 4 u
// (sqrt(3) reach + |t|) from the way to the view, whose translation is t; a centre has as much, and half axes 10 u
// reach more. That is 32 u reach + 8 u |t|. Add it to the radius of a sphere.
float view_rounding(mat4 view_from_world, vec3 reach) {
    return 2.4e-6 * (length(reach) + length(view_from_world[3].xyz));  // 40 u
}

// The same in clip space, for the tests of boxes. A translation of the projection rounds as well (orthographic views).
vec4 clip_rounding(mat4 clip_from_view, float rounding) {
    mat4 rows = transpose(clip_from_view);
    vec4 stretch = vec4(length(rows[0].xyz), length(rows[1].xyz), length(rows[2].xyz), length(rows[3].xyz));
    return stretch * rounding + ROUNDINGS * abs(clip_from_view[3]);
}

// --- outside of the view -------------------------------------------------------------------------------------------

bool sphere_beyond(vec4 plane, vec3 centre, float radius) {
    float stretch = length(plane.xyz);
    float margin = ROUNDINGS * (stretch * (length(centre) + radius) + abs(plane.w));
    return is_negative(dot(plane.xyz, centre) + plane.w + stretch * radius + margin);
}

// Whether a sphere in view space is outside of one plane of the frustum: left, right, bottom, top, near, and in an
// orthographic view far. The planes are sums of rows of the projection (Gribb and Hartmann 2001).
bool sphere_outside(vec3 centre_view, float radius, mat4 clip_from_view, bool orthographic) {
    mat4 rows = transpose(clip_from_view);
    vec4 x = rows[0], y = rows[1], z = rows[2], w = rows[3];
    return sphere_beyond(w + x, centre_view, radius) || sphere_beyond(w - x, centre_view, radius)
        || sphere_beyond(w + y, centre_view, radius) || sphere_beyond(w - y, centre_view, radius)
        || sphere_beyond(w - z, centre_view, radius) || (orthographic && sphere_beyond(z, centre_view, radius));
}

// Whether all corners of a box in clip space, centre +- x +- y +- z, are outside of one plane. `rounding` is how far
// its corners may be off, from `clip_rounding`. The largest distance of a corner from a plane is that of the centre
// plus the absolute ones of the half axes. An infinite view has z = near > 0 everywhere, and is never beyond its far
// plane.
bool box_outside(vec4 centre_clip, vec4 x_clip, vec4 y_clip, vec4 z_clip, vec4 rounding) {
    vec4 sizes = abs(centre_clip) + abs(x_clip) + abs(y_clip) + abs(z_clip);
    vec4 margin = rounding + ROUNDINGS * dot(sizes, vec4(1.0));  // NaN for all, if any of the coordinates is
    vec3 above = centre_clip.www + centre_clip.xyz;  // distances from x = -w, y = -w, z = -w
    above += abs(x_clip.www + x_clip.xyz) + abs(y_clip.www + y_clip.xyz) + abs(z_clip.www + z_clip.xyz);
    vec3 below = centre_clip.www - centre_clip.xyz;  // from x = w, y = w, z = w
    below += abs(x_clip.www - x_clip.xyz) + abs(y_clip.www - y_clip.xyz) + abs(z_clip.www - z_clip.xyz);
    float beyond = centre_clip.z + abs(x_clip.z) + abs(y_clip.z) + abs(z_clip.z);  // from z = 0
    above += margin.xyz + margin.w;
    below += margin.xyz + margin.w;
    return is_negative(min(min(min(above.x, above.y), min(below.x, below.y)), min(below.z, beyond + margin.z)));
}

bool box_outside(vec4 centre_clip, vec4 x_clip, vec4 y_clip, vec4 z_clip) {
    return box_outside(centre_clip, x_clip, y_clip, z_clip, vec4(0.0));
}

// --- the part of the picture ---------------------------------------------------------------------------------------

// A rectangle in ndc and the nearest depth in it. If it is not `known`, as of something that reaches the near plane,
// the rectangle is the whole picture, and the depth is nearer than any.
struct Footprint {
    vec2 low;
    vec2 high;
    float nearest;
    bool known;
};

const Footprint ANYWHERE = Footprint(vec2(-1.0), vec2(1.0), 2.0, false);

// The depth that a rasteriser may give to something between these depths. Vertices have errors of some roundings,
// below 1e-5. Within a triangle depth is a plane, which is evaluated at pixels up to 1/512 pixel outside of it, since
// its corners were snapped to 1/256; and software drivers evaluate it as a sum whose terms are slope times distance
// from the corner of the picture, with 3 u of those. For a slope of the whole range within a fifth of a pixel, and
// pictures of 3000 pixels along both edges, both together are 1/64 of the range.
float nearest_drawn(float nearest, float farthest) {
    return nearest + abs(nearest) * 1e-5 + (nearest - farthest) * 0.015625;
}

// The range of x / distance of the points of a sphere in front of the eye: the slopes m of its two tangents through
// the eye, (x - m distance)^2 = radius^2 (1 + m^2). Of the two roots the one without cancellation comes from the
// formula, the other from their product (x^2 - radius^2) / (distance^2 - radius^2), so that both have errors of some
// roundings.
vec2 tangents(float x, float distance, float radius) {
    float across = abs(x), front = (distance - radius) * (distance + radius);
    float sum = max(across * distance + radius * sqrt(across * across + front), 1e-30);  // 0 for a point on the axis
    vec2 slopes = vec2((across - radius) * (across + radius) / sum, sum / front);
    return x < 0.0 ? -slopes.yx : slopes;
}

// The footprint of a sphere in view space. The rectangle is the tightest one (Mara and McGuire 2013, "2D Polyhedral
// Bounds of a Clipped, Perspective-Projected 3D Sphere").
Footprint sphere_footprint(vec3 centre_view, float radius, mat4 clip_from_view, bool orthographic) {
    float distance = -centre_view.z, around = radius * (1.0 + ROUNDINGS);
    float front = distance - around, back = distance + around;
    vec2 scale = vec2(clip_from_view[0].x, clip_from_view[1].y), one, other;
    float nearest, farthest;
    bool known = radius >= 0.0;
    if (orthographic) {
        one = scale * (centre_view.xy - around) + clip_from_view[3].xy;
        other = scale * (centre_view.xy + around) + clip_from_view[3].xy;
        float error = ROUNDINGS * (abs(clip_from_view[2].z) * (abs(distance) + around) + abs(clip_from_view[3].z));
        nearest = clip_from_view[3].z - clip_from_view[2].z * front + error;
        farthest = clip_from_view[3].z - clip_from_view[2].z * back - error;
        known = known && nearest <= 1.0;
    } else {
        vec2 across = tangents(centre_view.x, distance, around), along = tangents(centre_view.y, distance, around);
        one = scale * vec2(across.x, along.x) - clip_from_view[2].xy;  // z is -distance
        other = scale * vec2(across.y, along.y) - clip_from_view[2].xy;
        float near = clip_from_view[3].z;
        nearest = near / front;
        farthest = near / back;
        known = known && front > near * (1.0 + ROUNDINGS);
    }
    if (!(known && are_moderate(vec3(one, nearest)) && are_moderate(vec3(other, farthest)))) {
        return ANYWHERE;
    }
    return Footprint(min(one, other), max(one, other), nearest_drawn(nearest, farthest), true);
}

// The footprint of a box in clip space, centre +- x +- y +- z, whose corners may be off by `rounding`. Where w > 0,
// the quotients by w have their extremes at corners. A corner that is off by dx and dw before the division is off by
// at most (dx + |x / w| dw) / (w - dw) after it.
Footprint box_footprint(vec4 centre_clip, vec4 x_clip, vec4 y_clip, vec4 z_clip, vec4 rounding) {
    vec4 margin = rounding + ROUNDINGS * (abs(centre_clip) + abs(x_clip) + abs(y_clip) + abs(z_clip));
    vec3 turns = vec3(x_clip.w, y_clip.w, z_clip.w);
    if (turns == vec3(0.0)) {
        // An orthographic view, whose depth is a difference of numbers around 1.
        margin.z += ROUNDINGS * abs(centre_clip.w);
    }
    float front = centre_clip.w - dot(abs(turns), vec3(1.0)) - margin.w;  // the least w
    float behind_near = centre_clip.w - centre_clip.z - abs(x_clip.w - x_clip.z) - abs(y_clip.w - y_clip.z)
                      - abs(z_clip.w - z_clip.z) - margin.w - margin.z;
    vec3 low = vec3(1e38), high = vec3(-1e38);
    for (uint corner = 0u; corner < 8u; ++corner) {
        vec4 place = centre_clip + ((corner & 1u) == 0u ? x_clip : -x_clip) + ((corner & 2u) == 0u ? y_clip : -y_clip)
                   + ((corner & 4u) == 0u ? z_clip : -z_clip);
        vec3 ndc = place.xyz / place.w;
        low = min(low, ndc);
        high = max(high, ndc);
    }
    vec3 error = (margin.xyz + max(abs(low), abs(high)) * margin.w) / front;
    low -= error;
    high += error;
    bool known = front > 0.0 && behind_near >= 0.0;
    if (!(known && are_moderate(low) && are_moderate(high))) {
        return ANYWHERE;
    }
    return Footprint(low.xy, high.xy, nearest_drawn(high.z, low.z), true);
}

Footprint box_footprint(vec4 centre_clip, vec4 x_clip, vec4 y_clip, vec4 z_clip) {
    return box_footprint(centre_clip, x_clip, y_clip, z_clip, vec4(0.0));
}

// The depth of the front of a box in a perspective view, as three planes over the picture: at (u, v) in ndc nothing in
// the box is nearer than q.x u + q.y v + q.z, for each column q. Of a wall that leads away from the eye this is far
// tighter than one nearest depth for all of it. Pieces of a wall along a street hide one another in this way alone.
//
// Between two opposite faces, c +- x with edges y and z, a ray is behind the one that is nearer to the eye. With
// p' = (x, y, w) of a point in clip space the faces are n . p' = n . (c' +- x'), where n = y' cross z', and the eye is
// 0. The nearer one has the distance D = |n . c'| - |n . x'|; if that is negative, the eye is between them, and they
// bound nothing. Divided by w, n . (u, v, 1) = D / w, and depth is near / w. A vertex that is off by `rounding` may be
// nearer to the eye by |n| . rounding. N has the absolute values of the terms of n: all roundings are below 16 u of sums
// of those. A rasteriser's own errors are those of `nearest_drawn`, but for snapped corners: widen the rectangle.
const vec3 NO_PLANE = vec3(0.0, 0.0, 2.0);

vec3 front_plane(vec3 centre, vec3 x, vec3 y, vec3 z, vec3 rounding, float near, float drawn) {
    vec3 normal = cross(y, z), terms = abs(y.yzx * z.zxy) + abs(y.zxy * z.yzx);
    float side = dot(normal, centre), sizes = dot(terms, abs(centre) + abs(x));
    float distance = abs(side) - abs(dot(normal, x)) - dot(terms, rounding) - ROUNDINGS * sizes;
    vec3 plane = normal * (side < 0.0 ? -near : near) / distance;
    plane.z += drawn + ROUNDINGS * (near * dot(terms, vec3(1.0)) / distance + dot(abs(plane), vec3(1.0)));
    // A flat box has an edge of 0, or of the smallest number there is: products with it are no numbers to rely on.
    return distance > 0.0 && sizes > 1e-30 && are_moderate(plane) ? plane : NO_PLANE;
}

mat3 front_planes(vec4 centre_clip, vec4 x_clip, vec4 y_clip, vec4 z_clip, vec4 rounding) {
    vec3 centre = centre_clip.xyw, x = x_clip.xyw, y = y_clip.xyw, z = z_clip.xyw, off = rounding.xyw;
    float near = centre_clip.z, around = abs(x.z) + abs(y.z) + abs(z.z) + rounding.w + ROUNDINGS * abs(centre.z);
    if (x.z == 0.0 && y.z == 0.0 && z.z == 0.0) {  // orthographic: one of the terms is w = 1
        return mat3(NO_PLANE, NO_PLANE, NO_PLANE);
    }
    float nearest = near / (centre.z - around), farthest = near / (centre.z + around);
    float drawn = nearest_drawn(nearest, farthest) - nearest;
    return mat3(
        front_plane(centre, x, y, z, off, near, drawn), front_plane(centre, y, z, x, off, near, drawn),
        front_plane(centre, z, x, y, off, near, drawn)
    );
}

// The nearest depth that such planes allow in the rectangle low..high of ndc.
float front_depth(mat3 planes, vec2 low, vec2 high) {
    vec3 depth = vec3(planes[0].z, planes[1].z, planes[2].z);
    depth += max(low.x * vec3(planes[0].x, planes[1].x, planes[2].x), high.x * vec3(planes[0].x, planes[1].x, planes[2].x));
    depth += max(low.y * vec3(planes[0].y, planes[1].y, planes[2].y), high.y * vec3(planes[0].y, planes[1].y, planes[2].y));
    return min(min(depth.x, depth.y), depth.z);
}

// The pixels first..last, both inclusive, that a footprint touches in a picture of `size`; those at the edge for one
// that is beyond it. A pixel counts as soon as any of its area is touched, since samples may lie anywhere in it.
//
// Rasterisers move vertices to a grid of 1/256 pixel (by 1/512 if they round, 1/256 if they cut off). Before that,
// clip positions have 4 u, their division 3 u and the viewport 2 u; the footprint has 16 u. Of the picture, -1 to 1 in
// ndc, that makes 25 u / 2 pixels for each pixel of its size.
void pixel_rect(Footprint footprint, vec2 size, out uvec2 first, out uvec2 last) {
    vec2 margin = 0.00390625 + ROUNDINGS * size, end = size - 1.0;
    vec2 low = footprint.known ? (footprint.low * 0.5 + 0.5) * size - margin : vec2(0.0);
    vec2 high = footprint.known ? (footprint.high * 0.5 + 0.5) * size + margin : end;
    first = uvec2(clamp(floor(low), vec2(0.0), end));
    last = max(first, uvec2(clamp(floor(high), vec2(0.0), end)));
}

// The same for one sample a pixel, in its centre: the pixels whose centres may be covered. Returns false if there are
// none, as for something that falls between the centres of four pixels. Things of a few pixels lose a fifth of their
// edges in this way, and it is far away that a scene has most of its things.
bool centre_rect(Footprint footprint, vec2 size, out uvec2 first, out uvec2 last) {
    vec2 margin = 0.00390625 + ROUNDINGS * size, end = size - 1.0;
    vec2 low = footprint.known ? ceil((footprint.low * 0.5 + 0.5) * size - 0.5 - margin) : vec2(0.0);
    vec2 high = footprint.known ? floor((footprint.high * 0.5 + 0.5) * size - 0.5 + margin) : end;
    first = uvec2(clamp(low, vec2(0.0), end));
    last = max(first, uvec2(clamp(high, vec2(0.0), end)));
    return all(lessThanEqual(low, high));
}

// The lowest level, from 1 on, at which pixels first..last are in at most 2x2 texels; those of level k have an edge of
// 2^k pixels. From one pixel to another, s pixels on, there is at most one edge of texels if s <= 2^k, and there are
// at least two if s >= 2^(k+1). In between it depends on where the first pixel is. (The logarithm of the size, rounded
// down, with one texel is not enough: parts of the rectangle are in other texels.) `findMSB` gets no 0, whose result is
// -1: NVIDIA's compiler for OpenGL (driver 580) compares it as unsigned in max(findMSB(span), 1).
uint occlusion_level(uvec2 first, uvec2 last) {
    uvec2 span = last - first;
    uint level = uint(findMSB(max(max(span.x, span.y), 2u)));
    uvec2 edges = (last >> level) - (first >> level);
    return max(edges.x, edges.y) > 1u ? level + 1u : level;
}

// --- facing away ---------------------------------------------------------------------------------------------------

// The eye in object space; with `orthographic`, `eye` and the result are directions of view. In object space the cone
// of normals is what it was when it was made: facing is the sign of a determinant, which every affine matrix keeps or,
// mirrored, turns around together with the winding of front faces.
//
// The rows of the inverse are cross products of the matrix's columns over the determinant (Cramer). Their errors are
// some roundings times the condition of the matrix. Where that is above 4096 (at times from 455 on), and for what is
// flat or not finite, the result is NaN, for which no cone faces away.
vec3 eye_in_object(mat3x4 world_from_object, vec3 eye, bool orthographic) {
    vec3 row0 = world_from_object[0].xyz, row1 = world_from_object[1].xyz, row2 = world_from_object[2].xyz;
    vec3 translation = vec3(world_from_object[0].w, world_from_object[1].w, world_from_object[2].w);
    float size = dot(abs(row0) + abs(row1) + abs(row2), vec3(1.0));  // of the matrix, so that no product overflows
    vec3 x = vec3(row0.x, row1.x, row2.x) / size, y = vec3(row0.y, row1.y, row2.y) / size;
    vec3 z = vec3(row0.z, row1.z, row2.z) / size;
    vec3 yz = cross(y, z), zx = cross(z, x), xy = cross(x, y);
    float determinant = dot(x, yz);
    float largest = sqrt(max(max(dot(yz, yz), dot(zx, zx)), dot(xy, xy)));
    if (!(abs(determinant) * 4096.0 > largest)) {
        return vec3(uintBitsToFloat(0x7FC00000u));
    }
    vec3 away = orthographic ? eye : eye - translation;
    return vec3(dot(yz, away), dot(zx, away), dot(xy, away)) / determinant / size;
}

// The sine of the angle by which all triangles have to be turned away. One that is seen nearly from its edge has no
// sure side: the eye in object space has errors, and vertices are rounded and snapped. A triangle with a least height
// h keeps its side from a sine of 3 shift / h on, where shift is how far its vertices move: twice its area on the
// screen, at least h times the sine times a third of the circumference, changes by the circumference times shift. This
// is twice as much, for heights of a sixteenth of the radius, which are those of even meshlets of 124 triangles. 1/64
// is for the eye. `shift` is `view_rounding` and 1/256 of a pixel at the distance of the meshlet; it and the radius
// are metres in the world.
float grazing_margin(float radius, float shift) { return 0.015625 + 96.0 * shift / radius; }

// Whether no triangle of a meshlet is seen from its front. `cone` has the axis and the sine of the half angle as four
// signed bytes (127 is 1, and a sine of 1 means: unknown); `centre` and `radius` are those of its sphere, all in
// object space, and `eye` is from `eye_in_object`. `margin` is a `grazing_margin`.
//
// For a point p of the sphere and a normal n of the cone, n.(p - eye) >= n.(centre - eye) - radius; and the angle
// between n and centre - eye is at most that of the axis plus the cone's, so that n.(centre - eye) >= |centre - eye|
// (cos - sine), since sin(a - b) >= sin a - sin b.
bool cone_faces_away(uint cone, vec3 centre, float radius, vec3 eye, bool orthographic, float margin) {
    vec4 axis = unpackSnorm4x8(cone);
    vec3 seen = orthographic ? eye : centre - eye;
    float front = (axis.w + margin) * length(seen) + (orthographic ? 0.0 : radius) - dot(seen, axis.xyz);
    return cone >> 24u != 127u && is_negative(front);
}

bool cone_faces_away(uint cone, vec3 centre, float radius, vec3 eye, bool orthographic) {
    return cone_faces_away(cone, centre, radius, eye, orthographic, 0.015625);
}
