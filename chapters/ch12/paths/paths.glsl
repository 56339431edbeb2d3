// A path tracer: light that reaches the eye along random paths (Kajiya 1986, "The Rendering Equation"). The mean of many paths
// through a pixel is its light.
//
// A path begins at the eye and is reflected at each surface that it hits, in a direction drawn in proportion to what the surface
// reflects. At each surface it also sends rays towards light (paths/lights.glsl). Sums of all paths stay in an image.
//
// Like rays/picture.glsl this text is one function of the number of a pixel in its tile, for every way of tracing.

#include "paths/lights.glsl"
#include "paths/ray_seed.glsl"
#include "paths/error.glsl"
#include "camera_ray.glsl"
#include "finite.glsl"
#include "rays/tile.glsl"
#include "rays/trace.glsl"

layout(BIND(3, PATH_BINDING, 0), rgba32f) uniform readonly image2D paths_before;
layout(BIND(3, PATH_BINDING + 1, 1), rgba32f) uniform readonly image2D squares_before;
layout(BIND(3, PATH_BINDING + 4, 2), rgba32f) uniform writeonly image2D history_paths;    // rgb: sums in nits, a: paths
layout(BIND(3, PATH_BINDING + 5, 3), rgba32f) uniform writeonly image2D history_squares;  // x: of luminance; y: paths left out
layout(BIND(3, PATH_BINDING + 6, 4), FORMAT) uniform writeonly image2D color_traced;

// Unlit surfaces are pictures that only the eye sees: they are no light, and all other rays pass through them.
const uint SEEN = 0xffu, SOLID = 3u;

// Blended surfaces decide by a number of the ray; the shaders of a ray pipeline find it themselves.
void begin_ray(Ray ray) {
#if defined(NON_OPAQUE) && !defined(RAYS_PIPELINE)
    path_seed = seed_of_ray(ray.origin, ray.direction, ray.t_min);
#endif
}

Hit trace_path(Ray ray, uint mask) {
    begin_ray(ray);
    return trace(ray, mask, 0u);
}

bool path_occluded(Ray ray) {
    begin_ray(ray);
    return occluded(ray, SOLID, 0u);
}

#include "paths/lens.glsl"

bool two_sided(uint instance) {
    return (uint(materials[instance_of(instance).material].uv_rows[1].w) & uint(DOUBLE_SIDED_FLAG)) != 0u;
}

// What arrives along a ray of the eye that hits nothing.
vec3 background_along(vec3 direction) {
#ifdef BACKGROUND
    return vec3(BACKGROUND);
#elif defined(ENVIRONMENT)
    return environment_along(direction);
#else
    return vec3(0.0);
#endif
}

// The part of light that counts for a reflected ray with density `own`, where rays towards light have density `other`. What
// these cannot find counts in full.
float share_of(float own, float other) {
    if (path.knobs.z == STRATEGY_BSDF || other <= 0.0) {
        return 1.0;
    }
    return path.knobs.z == STRATEGY_MIS ? power_heuristic(own, other) : 0.0;
}

// What arrives along a reflected ray that hits nothing, where it was drawn with density `pdf`.
vec3 surroundings_along(vec3 direction, float pdf) {
    vec3 light = frame.ambient.rgb * exposure();
#ifdef ENVIRONMENT
    float own = share_of(pdf, environment_pdf(turned_back(direction, frame.environment.yz)));
    light += own * environment_along(direction);
#endif
    return light;
}

// The part of the light of an emissive surface that counts for a reflected ray, which was drawn with density `pdf`.
float emission_share(Hit hit, Surface s, vec3 direction, float pdf) {
#ifdef EMITTERS
    return share_of(pdf, emitter_pdf_of(hit, direction, s.flat_normal));
#else
    return 1.0;
#endif
}

Bsdf bsdf_at(Surface s, vec3 view) {
#if defined(ENVIRONMENT) && ENERGY != 0
    float n_dot_v = min(abs(dot(s.normal, view)), 1.0);
    vec2 uv = table_uv(n_dot_v, s.roughness, float(textureSize(environment_table, 0).y));
    return bsdf_of(s.base_color, s.metallic, s.roughness, textureLod(environment_table, uv, 0.0).rgb, ENERGY);
#else
    float n_dot_v = min(abs(dot(s.normal, view)), 1.0);
    return bsdf_of(s.base_color, s.metallic, s.roughness, albedo_fit(n_dot_v, s.roughness), ENERGY_GLTF);
#endif
}

// What a collision in a medium has in place of a surface, until its position is known.
const Surface NO_SURFACE = Surface(
    SurfacePoint(vec3(0.0), vec3(0.0), 0.0), vec3(0.0), vec3(0.0), vec3(0.0), 0.0, 0.0, 0.0, vec3(0.0), true);

#ifdef FOG
// Moves the path to a collision before the hit, if there is one: the surface there has a position alone.
bool collides(Ray ray, float begin, Hit hit, inout Random random, inout Surface s, inout vec3 carried) {
    vec3 albedo;
    float at = collision(ray, begin, hit.instance == NO_HIT ? FAR : hit.t, random, albedo);
    in_medium = at < FAR;
    if (in_medium) {
        s.at = SurfacePoint(ray.origin + at * ray.direction, vec3(0.0), 0.0);
        carried *= albedo;
    }
    return in_medium;
}
#endif

#if defined(ENVIRONMENT) || defined(EMITTERS)
#define TABLES
#endif

// Something may stand before all light of one kind, so none is drawn more seldom than this.
const float LEAST_OF_A_KIND = 0.25;

// A ray towards light of any kind: to one of the scene's lights, or to what the tables draw.
LightRay ray_to_any_light(Surface s, Bsdf bsdf, vec3 view, inout Random random) {
    LightRay ray = NO_RAY;
#ifdef LIT
    ray = ray_to_one_light(s, bsdf, view, random.state);
#endif
#ifdef TABLES
    if (path.knobs.z != STRATEGY_BSDF) {
        LightRay drawn = ray_to_light_of_tables(s, bsdf, view, random);
        float first = luminance(ray.value), second = luminance(drawn.value);
        if (second > 0.0) {
            // In proportion to what each would add without shadows.
            float chosen = first > 0.0 ? clamp(second / (first + second), LEAST_OF_A_KIND, 1.0 - LEAST_OF_A_KIND) : 1.0;
            bool second_ray = pcg_float(random.state) < chosen;
            if (second_ray) {
                ray = drawn;
            }
            ray.value /= second_ray ? chosen : 1.0 - chosen;
        }
    }
#endif
    return ray;
}

// What rays towards light bring to the surface, or the collision, at which the path is.
vec3 direct_light(Surface s, Bsdf bsdf, vec3 view, float begin, inout Random random) {
    vec3 color = vec3(0.0);
    bool one = (path.knobs.w & PATH_ONE_LIGHT) != 0u;
    uint lights = 0u, rays = 1u;
#ifdef LIT
    lights = light_count.x;
#endif
    if (!one) {
        rays = lights;
#ifdef TABLES
        rays += uint(path.knobs.z != STRATEGY_BSDF);
#endif
    }
    for (uint i = 0u; i < rays; ++i) {
        LightRay towards = NO_RAY;
        if (one) {
            towards = ray_to_any_light(s, bsdf, view, random);
        }
#ifdef LIT
        else if (i < lights) {
            towards = ray_to_light(i, s, bsdf, view);
        }
#endif
#ifdef TABLES
        else {
            towards = ray_to_light_of_tables(s, bsdf, view, random);
        }
#endif
        towards.ray.t_min = begin;
        if (towards.value != vec3(0.0) && !path_occluded(towards.ray)) {
#ifdef FOG
            towards.value *= transmittance(towards.ray);
#endif
            color += towards.value;
        }
    }
    return color;
}

// A path on its way.
struct Path {
    Ray ray;
    Random random;
    vec3 color;    // the light that it has brought to the eye
    vec3 carried;  // the part of the light along its ray that reaches the eye
    float pdf;     // of the direction of the ray, where a surface reflected it
    uint bounce;
};

// Follows the ray of a path, whose t_min was `begin` at the eye (paths/ray_seed.glsl); says whether the path goes on.
bool next_vertex(inout Path at, float begin) {
    bool from_eye = at.bounce == 0u;
    Hit hit = trace_path(at.ray, from_eye ? SEEN : SOLID);
    Surface s = NO_SURFACE;
    Bsdf bsdf = Bsdf(vec3(0.0), 0.0, 1.0, ENERGY_GLTF, vec3(0.0), 0.0);
    vec3 view = -at.ray.direction;
    bool on_surface = true;
#ifdef FOG
    on_surface = !collides(at.ray, at.ray.t_min, hit, at.random, s, at.carried);
#endif
    if (on_surface) {
        if (hit.instance == NO_HIT) {
            at.color += at.carried * (from_eye ? background_along(at.ray.direction) : surroundings_along(at.ray.direction, at.pdf));
            return false;
        }
        s = surface_at(hit, at.ray.direction);
        bool behind = (hit.flags & HIT_BACK) != 0u && !two_sided(hit.instance);
        if (behind && from_eye) {  // backs are not drawn, either
            at.ray.t_min = hit.t;
            return true;
        }
        s.normal = behind ? -s.normal : s.normal;
        if (!behind && s.emission != vec3(0.0)) {
            at.color += at.carried * s.emission * (from_eye ? 1.0 : emission_share(hit, s, at.ray.direction, at.pdf));
        }
        bsdf = bsdf_at(s, view);
    }
    if (!s.lit || at.bounce >= path.knobs.x) {
        return false;
    }
    at.random.pair = PAIR_BOUNCE + PAIRS * at.bounce;
    vec2 choice = random_2d(at.random), u = random_2d(at.random);
    at.color += at.carried * direct_light(s, bsdf, view, begin, at.random);
    BsdfSample next = BsdfSample(vec3(0.0), 0.0, vec3(0.0));
    if (on_surface) {
        next = bsdf_sample(vec3(choice.x, u), bsdf, s.normal, view);
        at.carried *= dot(next.direction, s.flat_normal) > 0.0 ? next.weight : vec3(0.0);
        at.pdf = next.pdf;
    }
#ifdef FOG
    if (!on_surface) {
        next.direction = scattered_direction(view, u);
        at.pdf = phase_towards(next.direction, view);
    }
#endif
    if (at.carried == vec3(0.0)) {
        return false;
    }
    ++at.bounce;
    // The path goes on with the probability of what it carries, and then stands for those that ended (Arvo and Kirk 1990).
    if (at.bounce > path.knobs.y) {
        float stays = min(max(at.carried.r, max(at.carried.g, at.carried.b)), 1.0);
        if (choice.y >= stays) {
            return false;
        }
        at.carried /= stays;
    }
    at.ray = Ray(ray_origin(s.at, next.direction), begin, next.direction, FAR);
    return true;
}

// Whether the pixels around one, a block of 4 x 4, have paths enough. All of a block say the same.
bool is_done(ivec2 pixel, ivec2 size) {
    if (path.choice.z == 0.0) {
        return false;
    }
    ivec2 first = pixel & ~3, end = min(first + 4, size);
    float sum = 0.0;
    for (int y = first.y; y < end.y; ++y) {
        for (int x = first.x; x < end.x; ++x) {
            vec4 paths = imageLoad(paths_before, ivec2(x, y));
            if (paths.a < LEAST_PATHS) {
                return false;
            }
            sum += relative_error2(paths, imageLoad(squares_before, ivec2(x, y)).x, exposure());
        }
    }
    ivec2 sides = end - first;
    return sum <= path.choice.z * float(sides.x * sides.y);
}

// Path number `i` of this frame through a pixel, at the eye.
Path begun_path(ivec2 pixel, ivec2 size, uint i, float focus) {
    uint number = path.samples.x + i;
    Random random = random_of(uvec2(pixel), uint(size.x), number, path.samples.w);
    vec2 place = random_2d(random);
    place = (path.knobs.w & PATH_BOX) != 0u ? place : vec2(0.5);
    CameraRay seen = camera_ray(
        (vec2(pixel) + place) / vec2(size), frame.view_from_clip, frame.world_from_view, frame.orthographic != 0u);
#ifdef LENS
    seen = through_lens(seen, focus, random_2d(random));
#endif
    return Path(Ray(seen.origin, path_begin(i), seen.direction, FAR), random, vec3(0.0), vec3(1.0), 0.0, 0u);
}

void run(uvec3 id) {
    ivec2 size = imageSize(color_traced), pixel = ivec2(id.xy + tile.first.xy);
    if (any(greaterThanEqual(pixel, size))) {
        return;
    }
    bool goes_on = path.samples.z != 0u;
    vec4 sum = goes_on ? imageLoad(paths_before, pixel) : vec4(0.0), own = vec4(0.0);
    vec2 squares = goes_on ? imageLoad(squares_before, pixel).xy : vec2(0.0), own_squares = vec2(0.0);
    float focus = 0.0;
#ifdef LENS
    focus = focus_ahead();
#endif
    uint count = goes_on && is_done(pixel, size) ? 0u : path.samples.y;
    Path at;
    bool on_its_way = false;
    // One loop over the vertices of all paths: an invocation whose path ends begins the next one while its neighbours, which
    // share the processor's lanes, are still on their way.
    for (uint i = 0u; i < count;) {
        if (!on_its_way) {
            at = begun_path(pixel, size, i, focus);
        }
        on_its_way = next_vertex(at, path_begin(i));
        if (!on_its_way) {
            ++i;
            vec3 light = at.color / exposure();
            float seen2 = luminance(light) * luminance(light);
            if (all(lessThan(abs(vec4(light, seen2)), vec4(FAR)))) {  // neither NaN nor infinite
                own += vec4(light, 1.0);
                own_squares.x += seen2;
            } else {
                own_squares.y += 1.0;
            }
        }
    }
    sum += own;
    squares += own_squares;
    imageStore(history_paths, pixel, sum);
    imageStore(history_squares, pixel, vec4(squares, 0.0, 0.0));
    imageStore(color_traced, pixel, vec4(finite_color(sum.rgb * (exposure() / max(sum.a, 1.0))), 1.0));
}
