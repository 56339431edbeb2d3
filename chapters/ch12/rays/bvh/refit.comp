// Refits the hierarchies of deforming meshes, and the upper level, without a change of what is below what.
//
// TRIANGLES: copies the corners of triangles from the deformed positions in a page of geometry, an invocation a triangle.
// Without it: makes the boxes of the nodes in a list from those of their children, an invocation a node. A dispatch holds
// nodes of one level, and the levels follow one another from the deepest to the roots, so that no atomics are needed.

layout(local_size_x = 64) in;

struct Push {
    uvec4 run;  // x: first triangle, or first place in the list; y: count; z: the page, or 1 for nodes of the upper level
};
PUSH(Push, push)

#define BVH_WRITTEN 1
#define RAYS_SET 0
#define RAYS_BINDING 0
#include "rays/bvh/records.glsl"

#ifdef TRIANGLES
#include "watertight.glsl"

struct Mesh {
    uvec4 streams[2];  // as in scene/scene.glsl: the first word of positions, that of indices, the page
};
layout(BIND(0, 3, 3), std430) readonly buffer Meshes_ { Mesh meshes[]; };
layout(BIND(0, 4, 4), std430) readonly buffer Words_ { uint words[]; };

vec3 position_of(uint first, uint vertex) {
    uint at = first + 3u * vertex;
    return uintBitsToFloat(uvec3(words[at], words[at + 1u], words[at + 2u]));
}

// Comparisons with NaN are false.
bool is_placed(vec3 corner) { return all(lessThanEqual(abs(corner), vec3(1e18))); }

float cross_part(float a, float b, float c, float d) {
    precise float difference = a * b - c * d;
    return difference == 0.0 ? exact_difference(a, b, c, d) : difference;
}

bool has_area(vec3 a, vec3 b, vec3 c) {
    vec3 x = b - a, y = c - a;
    return cross_part(x.y, y.z, x.z, y.y) != 0.0 || cross_part(x.z, y.x, x.x, y.z) != 0.0
        || cross_part(x.x, y.y, x.y, y.x) != 0.0;
}

void main() {
    if (gl_GlobalInvocationID.x >= push.run.y) {
        return;
    }
    uint at = 3u * (push.run.x + gl_GlobalInvocationID.x);
    uint primitive = floatBitsToUint(bvh_triangles[at].w), owner = floatBitsToUint(bvh_triangles[at + 2u].w);
    Mesh mesh = meshes[owner];
    if (mesh.streams[1].w != push.run.z) {
        return;
    }
    uint index = mesh.streams[1].z + 3u * primitive;
    vec3 a = position_of(mesh.streams[0].x, words[index]);
    vec3 b = position_of(mesh.streams[0].x, words[index + 1u]);
    vec3 c = position_of(mesh.streams[0].x, words[index + 2u]);
    bool usable = is_placed(a) && is_placed(b) && is_placed(c) && has_area(a, b, c);
    bvh_triangles[at] = vec4(usable ? a : vec3(0.0), uintBitsToFloat(primitive));
    bvh_triangles[at + 1u] = vec4(usable ? b : vec3(0.0), uintBitsToFloat(usable ? 0u : BVH_UNUSABLE));
    bvh_triangles[at + 2u] = vec4(usable ? c : vec3(0.0), uintBitsToFloat(owner));
}
#else
layout(BIND(0, 3, 3), std430) readonly buffer List_ { uint list[]; };

void main() {
    if (gl_GlobalInvocationID.x >= push.run.y) {
        return;
    }
    uint node = 4u * list[push.run.x + gl_GlobalInvocationID.x];
    for (uint side = 0u; side < 2u; ++side) {
        uint at = node + 2u * side;
        uint code = floatBitsToUint(bvh_nodes[at].w);
        bool leaf = (code & BVH_LEAF) != 0u;
        // Boxes of instances are written where their matrices are.
        if (code == BVH_NO_CHILD || (leaf && push.run.z != 0u)) {
            continue;
        }
        vec3 low = uintBitsToFloat(uvec3(0x7F800000u)), high = -low;
        if (leaf) {
            uint first = code & ((1u << BVH_COUNT_SHIFT) - 1u);
            uint end = first + (code >> BVH_COUNT_SHIFT & 3u) + 1u;
            for (uint triangle = 3u * first; triangle < 3u * end; triangle += 3u) {
                vec3 a = bvh_triangles[triangle].xyz, c = bvh_triangles[triangle + 2u].xyz;
                vec4 b = bvh_triangles[triangle + 1u];
                if ((floatBitsToUint(b.w) & BVH_UNUSABLE) == 0u) {
                    low = min(low, min(a, min(b.xyz, c)));
                    high = max(high, max(a, max(b.xyz, c)));
                }
            }
        } else {
            low = min(bvh_nodes[4u * code].xyz, bvh_nodes[4u * code + 2u].xyz);
            high = max(bvh_nodes[4u * code + 1u].xyz, bvh_nodes[4u * code + 3u].xyz);
        }
        bvh_nodes[at].xyz = low;
        bvh_nodes[at + 1u].xyz = high;
    }
}
#endif
