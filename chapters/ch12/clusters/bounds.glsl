// Bounds of a light's reach, which may be too large and never too small.

// The radius beyond which a light gives exactly nothing: its range, or the distance of the cutoff.
float reach_of(Light light) {
    float range2 = light.inverse_range2 > 0.0 ? 1.0 / light.inverse_range2 : 1e36;
    return sqrt(min(min(range2, light.end_distance2), 1e36));
}

// The sphere around the lit part of a cone with half angle acos(cosine) and slant height `reach`: how far along the
// axis its centre is, and its radius. A narrow cone is bounded by its apex and its rim, a wide one by its rim alone.
vec2 cone_sphere(float cosine, float reach) {
    if (cosine > 0.70710678) {
        float radius = 0.5 * reach / cosine;
        return vec2(radius, radius);
    }
    return vec2(reach * cosine, reach * sqrt(max(1.0 - cosine * cosine, 0.0)));
}

// What float32 may lose on the way into the view: a part of the distance from the scene's origin and from the eye.
float widened(float radius, float distance) { return radius * 1.0001 + distance * 4e-6; }
