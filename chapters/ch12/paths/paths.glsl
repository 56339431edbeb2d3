// A path tracer: light that reaches the eye along random paths (Kajiya 1986, "The Rendering Equation"). The mean of many paths
// through a pixel is its light.
//
// A path begins at the eye and is reflected at each surface that it hits, in a direction drawn in proportion to what the surface
// reflects. At each surface it also sends rays towards light (paths/lights.glsl). Sums of all paths stay in an image.
//
// Like rays/picture.glsl this text is one function of the number of a pixel in its tile, for every way of tracing.

#include "paths/steps.glsl"
#include "rays/tile.glsl"

// What rays towards light bring to the surface, or the collision, at which the path is.
vec3 direct_light(Vertex v, float begin, inout Random random) {
    vec3 color = vec3(0.0);
    uint lights, rays = light_rays(lights);
    for (uint i = 0u; i < rays; ++i) {
        color += light_along(ray_towards_light(i, lights, v, begin, random));
    }
    return color;
}

// Follows the ray of a path, and says whether the path goes on. `begin` is t_min of all its rays (paths/ray_seed.glsl).
bool next_vertex(inout Walk walk, float begin) {
    Hit hit = trace_path(walk.ray, walk.bounce == 0u);
    Vertex v;
    if (!arrive(walk, hit, v)) {
        return false;
    }
    walk.random.pair = PAIR_BOUNCE + PAIRS * walk.bounce;
    vec2 choice = random_2d(walk.random), u = random_2d(walk.random);
    walk.color += walk.carried * direct_light(v, begin, walk.random);
    return leave(walk, v, choice, u, begin);
}

void run(uvec3 id) {
    ivec2 size = imageSize(color_traced), pixel = ivec2(id.xy + tile.first.xy);
    if (any(greaterThanEqual(pixel, size))) {
        return;
    }
    vec4 own = vec4(0.0);
    vec2 own_squares = vec2(0.0);
    float focus = 0.0;
#ifdef LENS
    focus = focus_ahead();
#endif
    uint count = paths_of(pixel, size);
    // A part of a larger picture has the paths of that one.
    ivec2 place = pixel + ivec2(path.crop.xy), whole = ivec2(path.crop.zw);
    Walk walk;
    bool on_its_way = false;
    // One loop over the vertices of all paths: an invocation whose path ends begins the next one while its neighbours, which
    // share the processor's lanes, are still on their way.
    for (uint i = 0u; i < count;) {
        if (!on_its_way) {
            walk = walk_from_eye(place, whole, i, focus);
        }
        on_its_way = next_vertex(walk, path_begin(i));
        if (!on_its_way) {
            ++i;
            add_path(walk.color, own, own_squares);
        }
    }
    store_sums(pixel, own, own_squares);
}
