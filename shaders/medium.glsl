// A medium's extinction per metre, the optical depth of a segment in closed form, and light that it scatters, summed
// along a ray. Float64 twin: tests/twins/fog.py.

// (1 - exp(-x)) / x for x >= 0, and 1 at 0: the mean of exp(-t) over t in 0..x. The difference cancels for small x, and
// a device's exp may be a few steps off; there it is the series, whose next term is below 2^-26 at one half.
float mean_transmittance(float x) {
    if (x < 0.5) {
        return 1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0
            * (1.0 - x / 7.0 * (1.0 - x / 8.0))))));
    }
    return (1.0 - exp(-x)) / x;
}

// --- densities, 1 where a part of the medium is as dense as its setting says ------------------------------------------

// Height fog: 1 up to `base`, exp(-falloff * height) above.
float height_density(float y, float base, float falloff) {
    return exp(-falloff * max(y - base, 0.0));
}

// 1 inside a box and on its faces, else 0.
float box_density(vec3 point, vec3 center, vec3 half_size) {
    return all(lessThanEqual(abs(point - center), half_size)) ? 1.0 : 0.0;
}

// --- means over a segment: times extinction and length they are its optical depth -------------------------------------

// The mean of `height_density` from one height to another: the part below the base, and an exponential above.
float height_mean(float y0, float y1, float base, float falloff) {
    float low = min(y0, y1) - base, high = max(y0, y1) - base;
    float below = high <= 0.0 ? 1.0 : low >= 0.0 ? 0.0 : clamp(-low / (high - low), 0.0, 1.0);
    float from = max(low, 0.0), to = max(high, 0.0);
    return below + (1.0 - below) * exp(-falloff * from) * mean_transmittance(falloff * (to - from));
}

// The part of a segment that lies inside a box (slabs, Kay and Kajiya 1986), 0 to 1.
float box_mean(vec3 start, vec3 end, vec3 center, vec3 half_size) {
    vec3 way = end - start, from = start - center;
    float first = 0.0, last = 1.0;
    for (int axis = 0; axis < 3; axis++) {
        if (way[axis] == 0.0) {
            if (abs(from[axis]) > half_size[axis]) return 0.0;
            continue;
        }
        float one = (-half_size[axis] - from[axis]) / way[axis];
        float other = (half_size[axis] - from[axis]) / way[axis];
        first = max(first, min(one, other));
        last = min(last, max(one, other));
    }
    return max(last - first, 0.0);
}

// --- along a ray ------------------------------------------------------------------------------------------------------

// Adds a segment of a ray: `fog` holds light so far and transmittance so far (0, 0, 0, 1 at the eye). `scattered` is
// light scattered to the eye per metre, `extinction` per metre; both are constant over `metres` along the ray.
// (After Hillaire 2015, without a division by the extinction, which loses the light of thin media.)
vec4 through_segment(vec4 fog, vec3 scattered, float extinction, float metres) {
    float depth = extinction * metres;
    float mean = mean_transmittance(depth);
    vec3 light = fog.rgb + fog.a * metres * mean * scattered;
    // exp(-depth) by the series too: a device's exp may be below 1 at 0, and a hundred slices multiply it.
    float left = depth < 0.5 ? 1.0 - depth * mean : exp(-depth);
    return vec4(light, fog.a * left);
}

// What a surface's colour becomes behind fog.
vec3 behind_fog(vec3 color, vec4 fog) {
    return color * fog.a + fog.rgb;
}

// History and current value of a froxel; a history that is not finite would never leave.
vec4 blended_history(vec4 history, vec4 current, float share) {
    bool lost = any(isnan(history)) || any(isinf(history));
    return lost ? current : mix(history, current, share);
}
