// Study screen-space-reflections: a ray through the depth buffer.
//
// A straight line stays straight on the screen, and along its picture the depth near / distance of reversed Z is linear
// in pixels: 1 / distance is what perspective interpolates linearly. So a ray is a segment of (column, row, depth), equal
// steps of it are equal steps on the screen, and no step divides. For the same reason the depth of a plane is linear
// between texels.

// Distance from the plane of the eye, metres, of depth `d`. The end of a ray may lie at infinity.
float distance_of(float d) {
    if (frame.orthographic != 0u) {
        return mix(frame.far, frame.near, d);
    }
    return d > 0.0 ? frame.near / d : 1e30;
}

// Where the ray from (ndc, d) along `direction` (of the view, any length) leaves what the picture shows: in ndc.
vec3 end_of(vec2 ndc, float d, vec3 direction) {
    vec4 from = vec4(ndc, d, 1.0), along = frame.clip_from_view * vec4(direction, 0.0);
    // Each is above 0 inside: four sides, the near plane, the far one. `from` is inside, so it leaves where one falls to 0.
    vec4 sides = vec4(1.0 - ndc, 1.0 + ndc), change = vec4(along.w - along.xy, along.w + along.xy);
    vec2 ends = vec2(1.0 - d, d), end_change = vec2(along.w - along.z, along.z);
    float t = 1e30;
    for (int i = 0; i < 4; i++) {
        t = change[i] < 0.0 ? min(t, sides[i] / -change[i]) : t;
    }
    for (int i = 0; i < 2; i++) {
        t = end_change[i] < 0.0 ? min(t, ends[i] / -end_change[i]) : t;
    }
    vec4 last = t < 1e30 ? from + t * along : along;  // never: it vanishes in a point at infinity
    return last.xyz / last.w;
}

vec3 in_pixels(vec3 ndc) {
    return vec3((ndc.xy * 0.5 + 0.5) * frame.size.xy, ndc.z);
}

ivec2 texel_of(vec2 place) {
    return clamp(ivec2(place), ivec2(0), ivec2(frame.size.xy) - 1);
}

// The depth that the picture shows at `place`, in pixels; 0 is the sky. Within a surface it is interpolated, which is
// exact on a plane. Across an outline there is nothing between two surfaces: there it is that of the nearest texel.
float depth_at(vec2 place) {
    vec2 corner = floor(place - 0.5), f = place - 0.5 - corner;
    ivec2 a = texel_of(corner), b = texel_of(corner + 1.0);
    vec4 d = vec4(
        texelFetch(depth, a, 0).r, texelFetch(depth, ivec2(b.x, a.y), 0).r,
        texelFetch(depth, ivec2(a.x, b.y), 0).r, texelFetch(depth, b, 0).r
    );
    float least = min(min(d.x, d.y), min(d.z, d.w)), most = max(max(d.x, d.y), max(d.z, d.w));
    if (least == 0.0 || distance_of(least) > distance_of(most) * (1.0 + THICKNESS)) {
        bvec2 second = greaterThanEqual(f, vec2(0.5));
        vec2 row = second.y ? d.zw : d.xy;
        return second.x ? row.y : row.x;
    }
    return mix(mix(d.x, d.y, f.x), mix(d.z, d.w, f.x), f.y);
}

// Whether the part of a ray from `low` to `high` ends behind the surface shown there, and not behind all of its thickness.
// Tested over the whole part, since a step may be longer than a surface is thick.
bool ends_inside(vec3 low, vec3 high) {
    float shown = depth_at(high.xy);
    float nearest = min(distance_of(low.z), distance_of(high.z));
    return shown > 0.0 && high.z < shown && nearest <= distance_of(shown) * (1.0 + THICKNESS);
}

// A ray meets a surface from its front. The surface that the ray leaves does not face it: no offset at the start is needed.
bool is_met(ivec2 pixel, vec3 direction) {
    vec3 n = normal_at(pixel);
    return n == vec3(0.0) || dot(n, direction) < 0.0;  // what is unlit has no normal
}

// March from `first` to `last` (column, row, depth); `direction` is the ray's in the world. Returns whether the ray meets
// what the picture shows, and where: at most a step / 2^REFINEMENTS behind it.
bool march(vec3 first, vec3 last, vec3 direction, out vec2 place) {
    vec3 before = first;
    for (int i = 1; i <= STEPS; i++) {
        vec3 here = mix(first, last, float(i) / float(STEPS));
        if (ends_inside(before, here)) {
            vec3 low = before, high = here;
            for (int k = 0; k < REFINEMENTS; k++) {
                vec3 middle = 0.5 * (low + high);
                if (middle.z < depth_at(middle.xy)) {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            if (ends_inside(low, high) && is_met(texel_of(high.xy), direction)) {
                place = high.xy;
                return true;
            }
        }
        before = here;
    }
    return false;
}
