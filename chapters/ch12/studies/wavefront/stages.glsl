// What the stages do with a path: begin it, find its hit, shade it, follow its rays towards light, and add its light.

shared uint longest[2];

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
        Walk walk = walk_from_eye(pixel + ivec2(path.crop.xy), ivec2(path.crop.zw), SAMPLE, focus);
        store_walk(i, walk);
        set_row(CARRIED, i, uvec4(floatBitsToUint(walk.carried), 0u));
    }
    set_row(COLOR, i, uvec4(0u, 0u, 0u, wanted));
    append_live(i, wanted, 0u);
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
