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
#ifdef SCALARISED
#include "clusters/subgroups.glsl"
#else
uvec2 joined_words(uint first, uint end) { return uvec2(first, end); }
uint joined_bits(uint bits) { return bits; }
#endif
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
    bool any = places >> 16 != 0u;
    walk.range = any ? uvec2(places & 0xffffu, places >> 16) - 1u : uvec2(1u, 0u);  // stored from 1 on
    walk.word = any ? walk.range.x >> 5 : 0u;
    walk.end = any ? (walk.range.y >> 5) + 1u : 0u;
#endif
#if (LIGHT_LISTS & 2) != 0
    uvec2 tile = uvec2(pixel) >> light_lists[LIST_TILE_LOG2];
    walk.tile = first_tile(light_lists[LIST_LIGHTS])
        + (tile.y * light_lists[LIST_TILES_X] + tile.x) * light_lists[LIST_TILE_WORDS];
#endif
    uvec2 words = joined_words(walk.word, walk.end);
    walk.word = words.x;
    walk.end = words.y;
#endif
    return walk;
}

#ifdef LIGHT_LISTS
// The places first to first + 31 that are in a range, a bit each.
uint places_in(uvec2 range, uint first) {
    uint low = max(range.x, first), high = min(range.y, first + 31u);
    return low <= high ? (~0u << (low - first)) & (~0u >> (first + 31u - high)) : 0u;
}

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
        walk.bits = places_in(walk.range, walk.word << 5);
#if (LIGHT_LISTS & 2) != 0
        walk.bits &= light_lists[walk.tile + walk.word];
#endif
        walk.bits = joined_bits(walk.bits);
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
