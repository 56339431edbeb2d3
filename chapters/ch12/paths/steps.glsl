// The steps of a path: a ray through a pixel, what is at a hit, rays towards light, and the next direction. A loop takes them
// one after another (paths/paths.glsl).

#include "paths/lights.glsl"
#include "paths/ray_seed.glsl"
#include "paths/sums.glsl"
#include "camera_ray.glsl"
#include "rays/trace.glsl"

// A path between two surfaces.
struct Walk {
    Ray ray;
    vec3 color;     // the light that was found so far
    vec3 carried;   // the part of further light that reaches the eye
    float pdf;      // of the direction of the ray, where a surface reflected it
    uint bounce;    // reflections so far
    Random random;
};

// A surface, or a collision in a medium, that a path has come to.
struct Vertex {
    Surface s;
    Bsdf bsdf;
    vec3 view;
    bool on_surface;
};

// Unlit surfaces are pictures that only the eye sees: they are no light, and all other rays pass through them.
const uint SEEN = 0xffu, SOLID = 3u;

// Blended surfaces decide by a number of the ray; the shaders of a ray pipeline find it themselves.
void begin_ray(Ray ray) {
#if defined(NON_OPAQUE) && !defined(RAYS_PIPELINE)
    path_seed = seed_of_ray(ray.origin, ray.direction, ray.t_min);
#endif
}

// The eye sees no backs of single-sided surfaces, as in drawn pictures.
Hit trace_path(Ray ray, bool from_eye) {
    begin_ray(ray);
    return trace(ray, from_eye ? SEEN : SOLID, from_eye ? SKIP_BACKS : 0u);
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

Walk walk_along(Ray ray, Random random) { return Walk(ray, vec3(0.0), vec3(1.0), 0.0, 0u, random); }

// Takes a path to its hit: adds the light that arrives there, and says whether the path goes on.
bool arrive(inout Walk walk, Hit hit, out Vertex v) {
    bool from_eye = walk.bounce == 0u;
    v = Vertex(
        NO_SURFACE, Bsdf(vec3(0.0), 0.0, 1.0, ENERGY_GLTF, vec3(0.0), 0.0), -walk.ray.direction, true);
#ifdef FOG
    v.on_surface = !collides(walk.ray, walk.ray.t_min, hit, walk.random, v.s, walk.carried);
#endif
    if (v.on_surface) {
        vec3 along = walk.ray.direction;
        if (hit.instance == NO_HIT) {
            walk.color += walk.carried * (from_eye ? background_along(along) : surroundings_along(along, walk.pdf));
            return false;
        }
        v.s = surface_at(hit, along);
        bool behind = (hit.flags & HIT_BACK) != 0u && !two_sided(hit.instance);
        v.s.normal = behind ? -v.s.normal : v.s.normal;
        if (!behind && v.s.emission != vec3(0.0)) {
            walk.color += walk.carried * v.s.emission * (from_eye ? 1.0 : emission_share(hit, v.s, along, walk.pdf));
        }
        v.bsdf = bsdf_at(v.s, v.view);
    }
    return v.s.lit && walk.bounce < path.knobs.x;
}

#if defined(ENVIRONMENT) || defined(EMITTERS)
#define TABLES
#endif

// Something may stand before all light of one kind, so none is drawn more seldom than this.
const float LEAST_OF_A_KIND = 0.25;

// A ray towards light of any kind: to one of the scene's lights, or to what the tables draw.
LightRay ray_to_any_light(Vertex v, inout Random random) {
    LightRay ray = NO_RAY;
#ifdef LIT
    ray = ray_to_one_light(v.s, v.bsdf, v.view, random.state);
#endif
#ifdef TABLES
    if (path.knobs.z != STRATEGY_BSDF) {
        LightRay drawn = ray_to_light_of_tables(v.s, v.bsdf, v.view, random);
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

// How many rays are sent towards light: one in all, or one to each of the scene's `lights` and one by the tables.
uint light_rays(out uint lights) {
    lights = 0u;
    if ((path.knobs.w & PATH_ONE_LIGHT) != 0u) {
        return 1u;
    }
#ifdef LIT
    lights = light_count.x;
#endif
    uint rays = lights;
#ifdef TABLES
    rays += uint(path.knobs.z != STRATEGY_BSDF);
#endif
    return rays;
}

// Ray `i` of these.
LightRay ray_towards_light(uint i, uint lights, Vertex v, float begin, inout Random random) {
    LightRay towards = NO_RAY;
    if ((path.knobs.w & PATH_ONE_LIGHT) != 0u) {
        towards = ray_to_any_light(v, random);
    }
#ifdef LIT
    else if (i < lights) {
        towards = ray_to_light(i, v.s, v.bsdf, v.view);
    }
#endif
#ifdef TABLES
    else {
        towards = ray_to_light_of_tables(v.s, v.bsdf, v.view, random);
    }
#endif
    towards.ray.t_min = begin;
    return towards;
}

// The light that arrives along it.
vec3 light_along(LightRay towards) {
    if (towards.value == vec3(0.0) || path_occluded(towards.ray)) {
        return vec3(0.0);
    }
#ifdef FOG
    towards.ray.t_max = towards.way;
    towards.value *= transmittance(towards.ray);
#endif
    return towards.value;
}

// Reflects or scatters a path by the random numbers `choice` and `u`; returns whether it goes on.
bool leave(inout Walk walk, Vertex v, vec2 choice, vec2 u, float begin) {
    BsdfSample next = BsdfSample(vec3(0.0), 0.0, vec3(0.0));
    if (v.on_surface) {
        next = bsdf_sample(vec3(choice.x, u), v.bsdf, v.s.normal, v.view);
        walk.carried *= dot(next.direction, v.s.flat_normal) > 0.0 ? next.weight : vec3(0.0);
        walk.pdf = next.pdf;
    }
#ifdef FOG
    if (!v.on_surface) {
        next.direction = scattered_direction(v.view, u);
        walk.pdf = phase_towards(next.direction, v.view);
    }
#endif
    if (walk.carried == vec3(0.0)) {
        return false;
    }
    ++walk.bounce;
    // The path goes on with the probability of what it carries, and then stands for those that ended (Arvo and Kirk 1990).
    if (walk.bounce > path.knobs.y) {
        float stays = min(max(walk.carried.r, max(walk.carried.g, walk.carried.b)), 1.0);
        if (choice.y >= stays) {
            return false;
        }
        walk.carried /= stays;
    }
    walk.ray = Ray(ray_origin(v.s.at, next.direction), begin, next.direction, FAR);
    return true;
}

// Path `i` of the frame through a pixel, before its first hit. `focus` is that of `focus_ahead`.
Walk walk_from_eye(ivec2 pixel, ivec2 size, uint i, float focus) {
    Random random = random_of(uvec2(pixel), uint(size.x), path.samples.x + i, path.samples.w);
    vec2 place = random_2d(random);
    place = (path.knobs.w & PATH_BOX) != 0u ? place : vec2(0.5);
    CameraRay seen = camera_ray(
        (vec2(pixel) + place) / vec2(size), frame.view_from_clip, frame.world_from_view, frame.orthographic != 0u);
#ifdef LENS
    seen = through_lens(seen, focus, random_2d(random));
#endif
    return walk_along(Ray(seen.origin, path_begin(i), seen.direction, FAR), random);
}
