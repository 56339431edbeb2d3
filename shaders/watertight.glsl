// Rays against triangles without gaps between neighbours (Woop, Benthin, Wald 2013, "Watertight Ray/Triangle
// Intersection"): space is sheared so that the ray becomes the z axis, and each corner gets one place (x, y) whatever
// triangle asks. A triangle is hit if (0, 0) is inside it, edges included.
//
// Rounding is monotone: where a b > c d, the rounded products are not in the other order. So the sign of a rounded
// product minus another is right or 0, and where it is 0, whole numbers decide. Neighbours see their common edge with
// opposite signs and the same magnitude, unless multiply and add are contracted: hence `precise`.
//
// Corners are to be within 1e18 of the ray's origin. Equal corners and corners that are not finite are never hit.

struct ShearedRay {
    vec3 origin;
    vec3 row_x, row_y, row_z;  // of the matrix that makes the ray's direction (0, 0, 1)
};

// Returns the shear along the largest part of the direction. Rows with x and y change places where that part is negative,
// which keeps the winding.
ShearedRay sheared_ray(vec3 origin, vec3 direction) {
    vec3 size = abs(direction);
    bool x_leads = size.x > size.y && size.x > size.z;
    bool y_leads = !x_leads && size.y > size.z;
    vec3 x = y_leads ? vec3(0.0, 0.0, 1.0) : x_leads ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0);
    vec3 y = y_leads ? vec3(1.0, 0.0, 0.0) : x_leads ? vec3(0.0, 0.0, 1.0) : vec3(0.0, 1.0, 0.0);
    vec3 z = y_leads ? vec3(0.0, 1.0, 0.0) : x_leads ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 0.0, 1.0);
    float ahead = y_leads ? direction.y : x_leads ? direction.x : direction.z;
    float side_x = y_leads ? direction.z : x_leads ? direction.y : direction.x;
    float side_y = y_leads ? direction.x : x_leads ? direction.z : direction.y;
    precise vec3 row_x = x - (side_x / ahead) * z;
    precise vec3 row_y = y - (side_y / ahead) * z;
    bool turned = ahead < 0.0;
    return ShearedRay(origin, turned ? row_y : row_x, turned ? row_x : row_y, z / ahead);
}

// Two of the three products are with 1 and 0: the result has two roundings, whatever the order of the sum.
vec3 sheared(ShearedRay ray, vec3 corner) {
    precise vec3 p = corner - ray.origin;
    precise float x = ray.row_x.x * p.x + ray.row_x.y * p.y + ray.row_x.z * p.z;
    precise float y = ray.row_y.x * p.x + ray.row_y.y * p.y + ray.row_y.z * p.z;
    precise float z = ray.row_z.x * p.x + ray.row_z.y * p.y + ray.row_z.z * p.z;
    return vec3(x, y, z);
}

// |a b| as a whole number of 48 bits, `high` and `low` with 24 each, times 2^exponent.
void whole_product(float a, float b, out uint high, out uint low, out int exponent) {
    uint bits_a = floatBitsToUint(a) & 0x7FFFFFFFu, bits_b = floatBitsToUint(b) & 0x7FFFFFFFu;
    uint exponent_a = bits_a >> 23u, exponent_b = bits_b >> 23u;
    uint whole_a = (bits_a & 0x7FFFFFu) | (exponent_a > 0u ? 0x800000u : 0u);
    uint whole_b = (bits_b & 0x7FFFFFu) | (exponent_b > 0u ? 0x800000u : 0u);
    uint carry, rest;
    umulExtended(whole_a, whole_b, carry, rest);
    high = carry << 8u | rest >> 24u;
    low = rest & 0xFFFFFFu;
    exponent = int(max(exponent_a, 1u)) + int(max(exponent_b, 1u)) - 300;
}

// a b - c d without any error but the last rounding; at least 2^-120 in size unless it is 0. To be asked where the
// products are equal or nearly equal.
float exact_difference(float a, float b, float c, float d) {
    bool ab_negative = ((floatBitsToUint(a) ^ floatBitsToUint(b)) >> 31u) != 0u;
    bool cd_negative = ((floatBitsToUint(c) ^ floatBitsToUint(d)) >> 31u) != 0u;
    uint high_ab, low_ab, high_cd, low_cd;
    int exponent_ab, exponent_cd;
    whole_product(a, b, high_ab, low_ab, exponent_ab);
    whole_product(c, d, high_cd, low_cd, exponent_cd);
    bool ab_is_0 = (high_ab | low_ab) == 0u, cd_is_0 = (high_cd | low_cd) == 0u;
    if (ab_is_0 && cd_is_0) {
        return 0.0;
    }
    // Both with the same exponent. Whole numbers from 2^46 on differ by one place at most where products are close; of
    // others the smaller one only has to stay below the larger one.
    int top_ab = ab_is_0 ? -1000000 : exponent_ab + (high_ab > 0u ? 24 + findMSB(high_ab) : findMSB(low_ab | 1u));
    int top_cd = cd_is_0 ? -1000000 : exponent_cd + (high_cd > 0u ? 24 + findMSB(high_cd) : findMSB(low_cd | 1u));
    float magnitude;
    bool negative;
    if (ab_negative != cd_negative || abs(top_ab - top_cd) > 1) {
        bool first = top_ab >= top_cd;
        magnitude = ldexp(1.0, clamp(max(top_ab, top_cd), -120, 120));
        negative = first ? ab_negative : !cd_negative;
    } else {
        int shift = exponent_ab - exponent_cd;
        for (; shift > 0; --shift) {
            high_ab = high_ab << 1u | low_ab >> 23u;
            low_ab = low_ab << 1u & 0xFFFFFFu;
            --exponent_ab;
        }
        for (; shift < 0; ++shift) {
            high_cd = high_cd << 1u | low_cd >> 23u;
            low_cd = low_cd << 1u & 0xFFFFFFu;
        }
        int high = int(high_ab) - int(high_cd), low = int(low_ab) - int(low_cd);
        if (high == 0 && low == 0) {
            return 0.0;
        }
        bool less = high < 0 || (high == 0 && low < 0);
        magnitude = abs(float(high) * 16777216.0 + float(low));
        magnitude = max(ldexp(magnitude, clamp(exponent_ab, -200, 78)), ldexp(1.0, -120));
        negative = less != ab_negative;
    }
    return negative ? -magnitude : magnitude;
}

// Whether the ray hits triangle a b c; then `t` counts in lengths of its direction, `at` are the barycentric coordinates
// of b and c, and `back` says that the corners run clockwise as the ray sees them. `t` may be negative.
bool hits_triangle(ShearedRay ray, vec3 a, vec3 b, vec3 c, out float t, out vec2 at, out bool back) {
    vec3 pa = sheared(ray, a), pb = sheared(ray, b), pc = sheared(ray, c);
    precise float u = pc.x * pb.y - pc.y * pb.x;
    precise float v = pa.x * pc.y - pa.y * pc.x;
    precise float w = pb.x * pa.y - pb.y * pa.x;
    if (u == 0.0 || v == 0.0 || w == 0.0) {
        u = u == 0.0 ? exact_difference(pc.x, pb.y, pc.y, pb.x) : u;
        v = v == 0.0 ? exact_difference(pa.x, pc.y, pa.y, pc.x) : v;
        w = w == 0.0 ? exact_difference(pb.x, pa.y, pb.y, pa.x) : w;
    }
    float sum = u + v + w;
    float inverse = 1.0 / sum;
    t = (u * pa.z + v * pb.z + w * pc.z) * inverse;
    at = vec2(v, w) * inverse;
    back = sum < 0.0;
    // Comparisons with NaN are false.
    return (min(min(u, v), w) >= 0.0 || max(max(u, v), w) <= 0.0) && sum != 0.0 && abs(t) < 1e37;
}
