// The medium of a scene (fog/scene.glsl) as paths meet it: the distance to the next collision, and how much of a ray arrives.
//
// Collisions in a sum of media are those of all of them together, each a Poisson process of its own. So the first one is the
// nearest of what each medium alone gives, and each of those follows from its optical depth in closed form. Delta tracking would
// give the same distribution by many steps (Woodcock et al. 1965).
//
// The constant medium and height fog fill the box around scene and eye. Noise counts by its mean, which is 1.

#ifdef FOG
#include "medium.glsl"
#include "phase.glsl"

bool in_medium = false;  // whether the path is at a collision, and not on a surface

// Where a ray is inside a box, as distances; none where the first is behind the second.
vec2 inside_box(Ray ray, vec3 center, vec3 half_size) {
    vec3 per = 1.0 / ray.direction;  // infinite along an axis that the ray does not move along
    vec3 near = (center - half_size - ray.origin) * per, far = (center + half_size - ray.origin) * per;
    vec3 low = min(near, far), high = max(near, far);
    vec3 from = abs(ray.origin - center);
    for (int axis = 0; axis < 3; ++axis) {
        if (ray.direction[axis] == 0.0) {
            low[axis] = from[axis] <= half_size[axis] ? 0.0 : FAR;
            high[axis] = FAR;
        }
    }
    return vec2(max(max(low.x, low.y), max(low.z, 0.0)), min(min(high.x, high.y), high.z));
}

vec2 inside_medium(Ray ray) {
    vec3 low = min(-fog.bounds.xyz, frame.eye.xyz), high = max(fog.bounds.xyz, frame.eye.xyz);
    return inside_box(ray, 0.5 * (low + high), 0.5 * (high - low));
}

float log_1p(float x) { return abs(x) < 1e-3 ? x * (1.0 - x * (0.5 - x / 3.0)) : log(1.0 + x); }

// The length after which a ray from height `y` above the base, which climbs by `climb` per metre, has passed `depth` metres of
// full density, where that is exp(-falloff y) above the base; FAR where it never does.
float length_in_height_fog(float y, float climb, float falloff, float depth) {
    float high = max(y, 0.0), rate = falloff * abs(climb), thin = falloff * high;
    if (rate < 1e-12) {
        return thin > 80.0 ? FAR : depth * exp(thin);
    }
    if (climb > 0.0) {
        float below = max(-y, 0.0) / climb;
        if (depth <= below) {
            return depth;
        }
        float left = thin > 80.0 ? 2.0 : (depth - below) * rate * exp(thin);
        return left >= 1.0 ? FAR : below - log_1p(-left) / rate;
    }
    float above = (1.0 - exp(-thin)) / rate;  // metres of full density down to the base
    if (depth > above) {
        return high / -climb + (depth - above);
    }
    return (thin < 20.0 ? log_1p(depth * rate * exp(thin)) : thin + log(exp(-thin) + depth * rate)) / rate;
}

float drawn_depth(inout Random random) { return -log(1.0 - pcg_float(random.state)); }

// The distance from `begin` on to the first collision before `end`, and the albedo there; FAR without one.
float collision(Ray ray, float begin, float end, inout Random random, out vec3 albedo) {
    float nearest = FAR;
    albedo = vec3(0.0);
    vec2 inside = inside_medium(ray);
    float first = max(inside.x, begin), last = min(inside.y, end);
    if (first < last && fog.constant.a > 0.0) {
        float at = first + drawn_depth(random) / fog.constant.a;
        if (at < last) {
            nearest = at;
            albedo = fog.constant.rgb;
        }
    }
    if (first < last && fog.height.a > 0.0) {
        float y = ray.origin.y + ray.direction.y * first - fog.shape.x;
        float depth = drawn_depth(random) / fog.height.a;
        float at = first + length_in_height_fog(y, ray.direction.y, fog.shape.y, depth);
        if (at < min(last, nearest)) {
            nearest = at;
            albedo = fog.height.rgb;
        }
    }
    for (uint i = 0u; i < fog.size.w; ++i) {
        inside = inside_box(ray, fog.boxes[i].center.xyz, fog.boxes[i].half_size.xyz);
        first = max(inside.x, begin);
        float extinction = fog.boxes[i].center.w, at = first + drawn_depth(random) / max(extinction, 1e-30);
        if (extinction > 0.0 && at < min(min(inside.y, end), nearest)) {
            nearest = at;
            albedo = fog.boxes[i].albedo.rgb;
        }
    }
    return nearest;
}

// The share of light that arrives along a ray, up to its t_max.
float transmittance(Ray ray) {
    float size = length(ray.direction);
    ray = Ray(ray.origin, 0.0, ray.direction / size, min(ray.t_max, FAR / max(size, 1.0)) * size);
    vec2 inside = inside_medium(ray);
    float last = min(inside.y, ray.t_max), metres = max(last - inside.x, 0.0);
    float depth = 0.0;
    if (metres > 0.0) {
        float y0 = ray.origin.y + ray.direction.y * inside.x, y1 = ray.origin.y + ray.direction.y * last;
        depth = metres * (fog.constant.a + fog.height.a * height_mean(y0, y1, fog.shape.x, fog.shape.y));
    }
    for (uint i = 0u; i < fog.size.w; ++i) {
        inside = inside_box(ray, fog.boxes[i].center.xyz, fog.boxes[i].half_size.xyz);
        depth += fog.boxes[i].center.w * max(min(inside.y, ray.t_max) - inside.x, 0.0);
    }
    return exp(-depth);
}

// The phase function for light that arrives from `to_light`: it is the density of `scattered_direction`, too.
float phase_towards(vec3 to_light, vec3 view) {
    return henyey_greenstein(one_minus_cosine(-to_light, view), fog.range.w);
}

vec3 scattered_direction(vec3 view, vec2 u) {
    float g = fog.range.w, s = 1.0 - 2.0 * u.x, cosine = s;
    if (abs(g) > 1e-3) {
        float part = (1.0 - g * g) / (1.0 + g * s);
        cosine = clamp((1.0 + g * g - part * part) / (2.0 * g), -1.0, 1.0);
    }
    float sine = sqrt(1.0 - cosine * cosine), phi = TURN * u.y;
    return frame_around(-view) * vec3(sine * cos(phi), sine * sin(phi), cosine);
}
#endif
