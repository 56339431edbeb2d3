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
    uint word;   // the next word of bits, and the one behind the last
    uint end;
    uint bits;   // lights of the word before that are still to come
    uint depth;  // the first words of the bits of the bin and of the tile
    uint tile;
#endif
};

LightWalk first_light(vec3 position, vec2 pixel) {
    LightWalk walk;
    walk.next = 0u;
#ifdef LIGHT_LISTS
    uint lights = light_lists[LIST_LIGHTS], words = light_lists[LIST_SET_WORDS];
    walk.word = 0u;
    walk.end = (light_count.x - light_count.y + 31u) >> 5;
    walk.bits = walk.depth = walk.tile = 0u;
#if (LIGHT_LISTS & 1) != 0
    float depth = -(frame.view_from_world * vec4(position, 1.0)).z;
    uint bin = bin_of(depth, light_lists[LIST_FIRST_BIN_CODE]);
    uint places = light_lists[first_bin(lights) + bin], last = places >> 16;  // from 1 on; 0: the bin is empty
    walk.word = last == 0u ? 0u : ((places & 0xffffu) - 1u) >> 5;
    walk.end = (last + 31u) >> 5;
    walk.depth = first_depth(lights) + bin * words;
#endif
#if (LIGHT_LISTS & 2) != 0
    uvec2 tile = uvec2(pixel) >> light_lists[LIST_TILE_LOG2];
    walk.tile = first_tile(lights, words) + (tile.y * light_lists[LIST_TILES_X] + tile.x) * words;
#endif
    uvec2 joined = joined_words(walk.word, walk.end);
    walk.word = joined.x;
    walk.end = joined.y;
#endif
    return walk;
}

#ifdef LIGHT_LISTS
// The lights of a word that the lists leave.
uint bits_of(LightWalk walk) {
#if LIGHT_LISTS == 0
    uint behind = light_count.x - light_count.y - (walk.word << 5);  // lights in this word and in later ones
    uint bits = behind >= 32u ? ~0u : (1u << behind) - 1u;
#else
    uint bits = ~0u;
#endif
#if (LIGHT_LISTS & 1) != 0
    bits &= light_lists[walk.depth + walk.word];
#endif
#if (LIGHT_LISTS & 2) != 0
    bits &= light_lists[walk.tile + walk.word];
#endif
    return joined_bits(bits);
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
        walk.bits = bits_of(walk);
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
    light.color *= exposure();
    return illuminance(light, position, smallest * smallest, to_light);
}
