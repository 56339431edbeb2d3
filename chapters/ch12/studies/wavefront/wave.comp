// The path tracer as stages over queues of paths (Laine, Karras and Aila 2013, "Megakernels Considered Harmful").
//
//     GENERATE    a path for each pixel of the tile -> the queue of live paths
//     NEXT        what the queues hold -> arguments of the next dispatches
//     EXTEND      live paths: the nearest hit
//     SHADE       live paths: light at the hit, rays towards light, a new direction -> the next queue, the queue of shadows
//     SHADOW      paths with rays towards light: what arrives along them
//     ADD         the light of each path -> sums of its pixel
//
// All stages are this text, and the constant STAGE leaves one of them in each pipeline: so all have one layout of bindings.
// The functions are those of the loop in paths/paths.glsl, and the random numbers, too.

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint STAGE = 0u;

const uint GENERATE = 0u, NEXT = 1u, EXTEND = 2u, SHADE = 3u, SHADOW = 4u, ADD = 5u;
const uint MOST_RAYS = 2u;  // towards light, of a path in a round

uvec2 path_pixel = uvec2(0u);
#define RAY_ID path_pixel
#include "paths/steps.glsl"
#include "rays/tile.glsl"
#include "studies/wavefront/wave.glsl"

// What a dispatch is told: x, y: the first pixel of the tile; z: its columns and rows; w: round, bits and sample.
#define COLUMNS (tile.first.z & 0xffffu)
#define ROWS (tile.first.z >> 16u)
#define ROUND (tile.first.w & 0x7ffu)
#define CLEARS ((tile.first.w & 0x800u) != 0u)
#define IS_LAST ((tile.first.w & 0x1000u) != 0u)
#define SAMPLE (tile.first.w >> 16u)

shared uint group_size, group_first, longest[2];

// Paths lie in blocks of 8 x 8 pixels, like the work groups of the loop.
bool pixel_of(uint i, out ivec2 pixel) {
    uint across = (COLUMNS + 7u) / 8u, block = i / 64u;
    uvec2 at = uvec2(block % across * 8u + i % 8u, block / across * 8u + i / 8u % 8u);
    pixel = ivec2(at + tile.first.xy);
    return all(lessThan(at, uvec2(COLUMNS, ROWS)));
}

// The place in a queue of an invocation that wants one: the whole group asks for its places at once.
uint place_in(uint counter, bool wanted) {
    bool first = gl_LocalInvocationIndex == 0u;
    if (first) {
        group_size = 0u;
    }
    barrier();
    uint own = wanted ? atomicAdd(group_size, 1u) : 0u;
    barrier();
    if (first) {
        group_first = atomicAdd(wave_head[counter], group_size);
    }
    barrier();
    return group_first + own;
}

void append_live(uint i, bool wanted, uint queue) {
    uint place = place_in(NEXT_LIVE, wanted);
    if (wanted) {
        wave[QUEUES * WAVE_PATHS + place][queue] = i;
    }
}

void store_walk(uint i, Walk walk) {
    store_ray(RAY, i, walk.ray, walk.pdf);
    store_random(i, walk.random);
}

void generate(uint i) {
    ivec2 pixel, size = imageSize(color_traced);
    bool inside = pixel_of(i, pixel), wanted = inside && SAMPLE < paths_of(pixel, size);
    path_pixel = uvec2(pixel);
    if (inside && SAMPLE == 0u) {
        set_row(OWN, i, vec4(0.0));
        wave[AT * WAVE_PATHS + i].zw = uvec2(0u);
    }
    if (wanted) {
        float focus = 0.0;
#ifdef LENS
        focus = focus_ahead();
#endif
        Walk walk = walk_from_eye(pixel, size, SAMPLE, focus);
        store_walk(i, walk);
        set_row(CARRIED, i, uvec4(floatBitsToUint(walk.carried), 0u));
    }
    set_row(COLOR, i, uvec4(0u, 0u, 0u, wanted));
    append_live(i, wanted, 0u);
}

// One work group.
void next() {
    uint id = gl_LocalInvocationIndex;
    if (IS_LAST && TOLD + id <= LAST_TOLD) {
        wave_told[id] = wave_head[TOLD + id];
    }
    if (CLEARS && TOLD + id <= LAST_TOLD) {
        wave_head[TOLD + id] = 0u;
    }
    if (id != 0u || IS_LAST) {
        return;
    }
    uint live = CLEARS ? 0u : wave_head[NEXT_LIVE], shadows = CLEARS ? 0u : wave_head[NEXT_SHADOWS];
    wave_head[LIVE] = live;
    wave_head[SHADOWS] = shadows;
    wave_head[NEXT_LIVE] = 0u;
    wave_head[NEXT_SHADOWS] = 0u;
    if (CLEARS) {
        return;
    }
    uint groups[] = uint[](LIVE_GROUPS, SHADOW_GROUPS), counts[] = uint[](live, shadows);
    for (uint k = 0u; k < 2u; ++k) {
        wave_head[groups[k]] = (counts[k] + 63u) / 64u;
        wave_head[groups[k] + 1u] = wave_head[groups[k] + 2u] = 1u;
    }
    wave_head[TOLD] += (live + LANES - 1u) / LANES * LANES;
    wave_head[min(TOLD + 2u + ROUND, LAST_TOLD)] += live;
}

void extend(uint i) {
    Walk walk = walk_along(ray_at(RAY, i), Random(0u, 0u, 0u, 0u));
    store_hit(i, trace_path(walk.ray, ROUND == 0u));
}

// Returns whether the path goes on; `asks` says whether it has sent rays towards light.
bool shade(uint i, out bool asks) {
    uvec4 carried = row(CARRIED, i), color = row(COLOR, i);
    Walk walk = Walk(
        ray_at(RAY, i), uintBitsToFloat(color.xyz), uintBitsToFloat(carried.xyz), row_of_floats(RAY + 1u, i).w, ROUND,
        random_at(i));
    Vertex v;
    asks = false;
    bool goes_on = arrive(walk, hit_at(i), v);
    if (goes_on) {
        float begin = path_begin(SAMPLE);
        walk.random.pair = PAIR_BOUNCE + PAIRS * walk.bounce;
        vec2 choice = random_2d(walk.random), u = random_2d(walk.random);
        uint lights, rays = min(light_rays(lights), MOST_RAYS);
        for (uint number = 0u; number < MOST_RAYS; ++number) {
            LightRay towards = NO_RAY;
            if (number < rays) {
                towards = ray_towards_light(number, lights, v, begin, walk.random);
            }
            asks = asks || towards.value != vec3(0.0);
            store_light_ray(number, i, towards);
        }
        set_row(BEFORE, i, vec4(walk.carried, 0.0));
        goes_on = leave(walk, v, choice, u, begin);
        if (goes_on) {
            store_walk(i, walk);
        }
    }
    set_row(COLOR, i, uvec4(floatBitsToUint(walk.color), color.w));
    set_row(CARRIED, i, uvec4(floatBitsToUint(walk.carried), carried.w + 1u));
    return goes_on;
}

void shadow(uint i) {
    vec3 sum = vec3(0.0);
    for (uint number = 0u; number < MOST_RAYS; ++number) {
        sum += light_along(light_ray_at(number, i, path_begin(SAMPLE)));
    }
    uvec4 color = row(COLOR, i);
    vec3 light = uintBitsToFloat(color.xyz) + row_of_floats(BEFORE, i).xyz * sum;
    set_row(COLOR, i, uvec4(floatBitsToUint(light), color.w));
}

void add(uint i) {
    ivec2 pixel;
    bool inside = pixel_of(i, pixel);
    uint local = gl_LocalInvocationIndex;
    if (local < 2u) {
        longest[local] = 0u;
    }
    barrier();
    uvec4 color = row(COLOR, i);
    if (inside) {
        vec4 own = row_of_floats(OWN, i);
        vec2 own_squares = row_of_floats(AT, i).zw;
        if (color.w != 0u) {
            add_path(uintBitsToFloat(color.xyz), own, own_squares);
            atomicMax(longest[local / LANES], row(CARRIED, i).w);
        }
        set_row(OWN, i, own);
        wave[AT * WAVE_PATHS + i].zw = floatBitsToUint(own_squares);
        if (IS_LAST) {
            store_sums(pixel, own, own_squares);
        }
    }
    barrier();
    if (local == 0u) {
        atomicAdd(wave_head[TOLD + 1u], LANES * (longest[0] + longest[1]));
    }
}

void main() {
    uint id = gl_GlobalInvocationID.x;
    if (STAGE == GENERATE) {
        generate(id);
    } else if (STAGE == NEXT) {
        next();
    } else if (STAGE == ADD) {
        add(id);
    } else {
        bool is_shadow = STAGE == SHADOW, within = id < wave_head[is_shadow ? SHADOWS : LIVE];
        uint turn = ROUND & 1u, i = within ? wave[QUEUES * WAVE_PATHS + id][is_shadow ? 2u : turn] : 0u;
        ivec2 pixel;
        pixel_of(i, pixel);
        path_pixel = uvec2(pixel);
        bool goes_on = false, asks = false;
        if (within && STAGE == EXTEND) {
            extend(i);
        }
        if (within && STAGE == SHADE) {
            goes_on = shade(i, asks);
        }
        if (within && STAGE == SHADOW) {
            shadow(i);
        }
        if (STAGE == SHADE) {
            append_live(i, goes_on, turn ^ 1u);
            uint place = place_in(NEXT_SHADOWS, asks);
            if (asks) {
                wave[QUEUES * WAVE_PATHS + place].z = i;
            }
        }
    }
}
