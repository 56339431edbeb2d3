// Study far-march: a plain, and spheres on it to the left and to the right in turn, each 1.41 times as far away as the one
// before, and as large.

struct Seen {
    float depth;
    vec3 color;
};

const int SPHERES = 8;

vec3 lit_surface(float albedo, vec3 normal, float y) {
    return albedo * (sun_at(y) * max(dot(normal, air.sun.xyz), 0.0) / 3.14159265 + air.sky.rgb);
}

Seen seen_along(Ray ray) {
    if (air.lit.w > 0.0) {
        return Seen(air.lit.w, vec3(0.0));
    }
    Seen seen = Seen(air.target.z, 0.5 * air.sky.rgb);
    float down = -ray.start.y / ray.way.y;
    if (ray.way.y < 0.0 && down < seen.depth) {
        vec2 place = (ray.start + ray.way * down).xz;
        float dark = mod(floor(place.x / 8.0) + floor(place.y / 8.0), 2.0);
        // Squares below a pixel would flicker: far away their mean is left.
        seen = Seen(down, lit_surface(mix(0.3, dark > 0.5 ? 0.2 : 0.4, exp(-down / 150.0)), vec3(0.0, 1.0, 0.0), 0.0));
    }
    for (int i = 0; i < SPHERES; ++i) {
        float ahead = 14.0 * exp2(0.5 * float(i)), radius = 0.09 * ahead;
        float side = 0.14 + 0.16 * float(i / 2);
        vec3 center = vec3((i & 1) == 0 ? -side * ahead : side * ahead, radius, -ahead);
        vec3 from = ray.start - center;
        float a = dot(ray.way, ray.way), b = dot(from, ray.way), c = dot(from, from) - radius * radius;
        float inside = b * b - a * c;
        float at = inside > 0.0 ? (-b - sqrt(inside)) / a : -1.0;
        if (at > 0.0 && at < seen.depth) {
            vec3 normal = (from + ray.way * at) / radius;
            seen = Seen(at, lit_surface(0.5, normal, ray.start.y + ray.way.y * at));
        }
    }
    return seen;
}
