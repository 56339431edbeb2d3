// The record of a froxel: fog up to where it begins (light, and transmittance), and what it adds (light and extinction
// per metre). Eight numbers, in 16 bytes as halves, or in 32.

#ifdef FOG_FULL
#define RECORD_WORDS 2
#else
#define RECORD_WORDS 1
#endif

uint record_at(ivec3 froxel) {
    uint number = (uint(froxel.z) * fog.size.y + uint(froxel.y)) * fog.size.x + uint(froxel.x);
    return fog.places.y + number * uint(RECORD_WORDS);
}

uvec2 halves_of(vec4 value) { return uvec2(packHalf2x16(value.xy), packHalf2x16(value.zw)); }

vec4 of_halves(uvec2 words) { return vec4(unpackHalf2x16(words.x), unpackHalf2x16(words.y)); }

void read_record(ivec3 froxel, out vec4 before, out vec4 here) {
    uint at = record_at(froxel);
#ifdef FOG_FULL
    before = uintBitsToFloat(fog_store[at]);
    here = uintBitsToFloat(fog_store[at + 1u]);
#else
    uvec4 words = fog_store[at];
    before = of_halves(words.xy);
    here = of_halves(words.zw);
#endif
}

#ifdef FOG_WRITTEN
void write_record(ivec3 froxel, vec4 before, vec4 here) {
    uint at = record_at(froxel);
#ifdef FOG_FULL
    fog_store[at] = floatBitsToUint(before);
    fog_store[at + 1u] = floatBitsToUint(here);
#else
    fog_store[at] = uvec4(halves_of(before), halves_of(here));
#endif
}
#endif
