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

// The light that arrives at the eye by one path.
vec3 light_of_path(Walk walk) {
    float begin = walk.ray.t_min;  // next to 0 (paths/ray_seed.glsl)
    while (true) {
        Hit hit = trace_path(walk.ray, mask_of(walk));
        Vertex v;
        uint next = arrive(walk, hit, v);
        if (next == ENDS) {
            return walk.color;
        }
        if (next == PASSES) {
            walk.ray.t_min = hit.t;
            continue;
        }
        walk.random.pair = PAIR_BOUNCE + PAIRS * walk.bounce;
        vec2 choice = random_2d(walk.random), u = random_2d(walk.random);
        walk.color += walk.carried * direct_light(v, begin, walk.random);
        if (!leave(walk, v, choice, u, begin)) {
            return walk.color;
        }
    }
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
    for (uint i = 0u; i < count; ++i) {
        add_path(light_of_path(walk_from_eye(pixel, size, i, focus)), own, own_squares);
    }
    store_sums(pixel, own, own_squares);
}
