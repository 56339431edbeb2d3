// The tables by which rays are sent towards light; paths/model.py lays them out.
//
//     entries of the environment's table of aliases: the texels of a cube map
//     entries of the table of emissive triangles
//     for each of these triangles x: its instance, y: its number in the mesh
//     for each instance the number of its first emissive triangle, or NO_LIGHT; four to a record
//     the tree of lights that have a place (light_tree.glsl)

#include "paths/frame.glsl"
#include "alias.glsl"

layout(BIND(3, PATH_BINDING + 2, 8), std430) readonly buffer Path_tables_ { uvec4 path_tables[]; };

const uint NO_LIGHT = 0xFFFFFFFFu;

// A number drawn from the table of `entries` entries that begins at `first`, and its probability.
uint drawn_from(uint first, uint entries, uvec2 bits, out float probability) {
    uint entry = alias_entry(bits.x, entries);
    return alias_pick(entry, path_tables[first + entry], bits.y, probability);
}

float probability_in(uint first, uint number) { return uintBitsToFloat(path_tables[first + number].z); }

// The number of triangle `primitive` of an instance among the emissive ones.
uint emissive_number(uint instance, uint primitive) {
    uint first = path_tables[path.tables.w + (instance >> 2u)][instance & 3u];
    return first == NO_LIGHT ? NO_LIGHT : first + primitive;
}
