// The loop over the lights of a surface: directional lights first, then the others, nearest to the camera first.
//
//     LightWalk walk = first_light(position, gl_FragCoord.xy);
//     for (uint i; next_light(walk, i);) { ... lights[i] ... }
//
// Every path sums in this order, brute force included. What the lists leave out would have added exactly nothing, so all
// paths give the same bits. LIGHT_LISTS says what selects the lights: bit 0 the bin of the depth, bit 1 the tile. Without
// it the scene has few lights, and they come in its order.

#ifdef LIGHT_LISTS
#include "clusters/layout.glsl"
#endif

struct LightWalk {
    uint next;   // the next light of those that come without a list
#ifdef LIGHT_LISTS
    uvec2 range;  // first and last place in the order
    uint word;   // the next word of bits, and the one behind the last
    uint end;
    uint bits;   // lights of the word before that are still to come
    uint tile;   // the first word of the tile's bits
#endif
};

LightWalk first_light(vec3 position, vec2 pixel) {
    LightWalk walk;
    walk.next = 0u;
#ifdef LIGHT_LISTS
    uint count = light_count.x - light_count.y;
    walk.range = uvec2(0u, max(count, 1u) - 1u);
    walk.word = 0u;
    walk.end = (count + 31u) >> 5;
    walk.bits = 0u;
    walk.tile = 0u;
#if (LIGHT_LISTS & 1) != 0
    float depth = -(frame.view_from_world * vec4(position, 1.0)).z;
    uint bin = bin_of(depth, light_lists[LIST_FIRST_BIN_CODE]);
    uint places = light_lists[first_bin(light_lists[LIST_LIGHTS]) + bin];
    walk.range = uvec2(places & 0xffffu, places >> 16);  // from 1 on; 0 as the last one: the bin is empty
    walk.end = walk.range.y == 0u ? 0u : ((walk.range.y - 1u) >> 5) + 1u;
    walk.range -= min(walk.range, uvec2(1u));
    walk.word = min(walk.range.x >> 5, walk.end);
#endif
#if (LIGHT_LISTS & 2) != 0
    uvec2 tile = uvec2(pixel) >> light_lists[LIST_TILE_LOG2];
    walk.tile = first_tile(light_lists[LIST_LIGHTS])
        + (tile.y * light_lists[LIST_TILES_X] + tile.x) * light_lists[LIST_TILE_WORDS];
#endif
#endif
    return walk;
}

#ifdef LIGHT_LISTS
bool next_light(inout LightWalk walk, out uint light) {
    light = walk.next;
    if (walk.next < light_count.y) {
        walk.next += 1u;
        return true;
    }
    while (walk.bits == 0u) {
        if (walk.word == walk.end) {
            return false;
        }
        uint first = walk.word << 5;
        uint low = max(walk.range.x, first) - first, high = min(walk.range.y, first + 31u) - first;
        walk.bits = (~0u << low) & (~0u >> (31u - high));
#if (LIGHT_LISTS & 2) != 0
        walk.bits &= light_lists[walk.tile + walk.word];
#endif
        walk.word += 1u;
    }
    uint bit = uint(findLSB(walk.bits));
    walk.bits &= walk.bits - 1u;
    light = light_lists[uint(LIST_HEADER) + ((walk.word - 1u) << 5) + bit];
    return true;
}
#else
bool next_light(inout LightWalk walk, out uint light) {
    light = walk.next;
    walk.next += 1u;
    return light < light_count.x;
}
#endif

// The illuminance of a light at a surface that faces it, exposed; see lights.glsl. The exposure comes first: candela at a
// short distance may be more than a float holds.
vec3 exposed_illuminance(uint number, vec3 position, out vec3 to_light) {
    float smallest = 1e-6 * frame.eye.w;  // of the scene's length scale: nearer lights are not told apart
    Light light = lights[number];
    light.color *= frame.exposure;
    return illuminance(light, position, smallest * smallest, to_light);
}
