// Study buffer-addresses: the three vertices of the nearest hit, by the addresses of its instance.

#extension GL_EXT_ray_tracing : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require

#include "addresses.glsl"
#include "payload.glsl"
#include "palette.glsl"

struct Entry {
    uvec2 indices, positions, attributes, spare;
};
layout(BIND(0, 3, 0), std430) readonly buffer Table_ { Entry entries[]; };

// What lies at an address; the compiler may assume no alignment but that of a word.
layout(buffer_reference, buffer_reference_align = 4, std430) readonly buffer Word { uint word; };

layout(location = 0) rayPayloadInEXT Fetched found;
hitAttributeEXT vec2 at;

uint word_at(uvec2 base, uint word) { return Word(address_of(base, word)).word; }

vec3 vector_at(uvec2 base, uint word) {
    return uintBitsToFloat(uvec3(word_at(base, word), word_at(base, word + 1u), word_at(base, word + 2u)));
}

const vec3 TO_LIGHT = vec3(0.3, 0.5, 0.8124);

void main() {
    Entry entry = entries[gl_InstanceCustomIndexEXT];
    vec3 weights = vec3(1.0 - at.x - at.y, at);
    vec3 normal = vec3(0.0), color = vec3(0.0), position = vec3(0.0);
    uint sum = 0u;
    for (uint corner = 0u; corner < 3u; ++corner) {
        uint vertex = word_at(entry.indices, 3u * uint(gl_PrimitiveID) + corner);
        vec3 place = vector_at(entry.positions, 3u * vertex);
        position += weights[corner] * place;
        normal += weights[corner] * vector_at(entry.attributes, 4u * vertex);
        color += weights[corner] * unpackUnorm4x8(word_at(entry.attributes, 4u * vertex + 3u)).rgb;
        // All bits that were read, so that a test can tell one wrong bit.
        uvec3 bits = floatBitsToUint(place);
        sum = scrambled(sum ^ bits.x);
        sum = scrambled(sum ^ bits.y);
        sum = scrambled(sum ^ bits.z);
    }
    float light = 0.2 + 0.8 * max(dot(normalize(normal), TO_LIGHT), 0.0);
    // The place by its vertices and the place on the ray are one, if these are the vertices that were hit.
    float off = distance(position, gl_WorldRayOriginEXT + gl_HitTEXT * gl_WorldRayDirectionEXT);
    found = Fetched(
        vec4(light * color, gl_HitTEXT),
        uvec4(uint(gl_InstanceCustomIndexEXT), uint(gl_PrimitiveID), sum, floatBitsToUint(off)));
}
