// Builds the hierarchy of a mesh anew from its triangles as they are now: where a mesh has bent so far that refits leave
// boxes large (Karras 2012, "Maximizing Parallelism in the Construction of BVHs, Octrees, and k-d Trees").
//
// Triangles lie in Morton order. A node splits its triangles where the highest bit in which their codes differ changes. All
// nodes follow at once from the sorted codes, each with the range of triangles below it, and a tree of halves over all
// triangles has the box of any range: so the number of triangles says how many dispatches there are, whatever the codes are.
// A range of four or less is a leaf; what would be a node of such a range is left without children.
//
// CODES: pairs of code and primitive. ORDER: primitives in sorted order into the records; refit.comp then fetches their
// corners. BOXES: those of triangles. HALVES: one level of the tree of halves. NODES: the hierarchy.
//
// UPPER: the upper level, whose primitives are the records of instances. Those stay in their places, and leaves of one name
// them. instances.comp has written the box of each where the slot says; NODES says where it is written from now on.

layout(local_size_x = 64) in;

struct Push {
    uvec4 mesh;  // x: its node 0, y: first triangle, z: triangles, w: bits of codes that decide
    uvec4 step;  // x: first box of the level of the tree of halves, which has as many; y: boxes of its lowest; z: first pair
};
PUSH(Push, push)

#define BVH_WRITTEN 1
#define RAYS_SET 0
#define RAYS_BINDING 0
#include "rays/bvh/records.glsl"

layout(BIND(0, 3, 3), std430) buffer Pairs_ { uvec2 pairs[]; };
layout(BIND(0, 4, 4), std430) buffer Halves_ { vec4 halves[]; };  // low and high of box 1, 2, ...; those below k: 2 k, 2 k + 1

const uint CODE_BITS = 30u;
#ifdef UPPER
const uint LEAF_LARGEST = 1u;
layout(BIND(0, 5, 5), std430) buffer Slots_ { uvec4 slots[]; };  // bvh/model.py, SLOT
#else
const uint LEAF_LARGEST = 4u;
#endif

#ifdef CODES
// The bits of x below 2^10 with two zeros behind each.
uint spread(uint x) {
    x = (x | x << 16u) & 0x030000FFu;
    x = (x | x << 8u) & 0x0300F00Fu;
    x = (x | x << 4u) & 0x030C30C3u;
    return (x | x << 2u) & 0x09249249u;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.mesh.z) {
        return;
    }
    uint root = 4u * push.mesh.x;
    vec3 low = min(bvh_nodes[root].xyz, bvh_nodes[root + 2u].xyz);
    vec3 high = max(bvh_nodes[root + 1u].xyz, bvh_nodes[root + 3u].xyz);
#ifdef UPPER
    uint at = 2u * slots[i].y, primitive = i;
    vec3 first = bvh_nodes[at].xyz, last = bvh_nodes[at + 1u].xyz;
    bool usable = all(lessThanEqual(first, last));
#else
    uint at = 3u * (push.mesh.y + i);
    vec4 a = bvh_triangles[at], b = bvh_triangles[at + 1u], c = bvh_triangles[at + 2u];
    vec3 first = min(a.xyz, min(b.xyz, c.xyz)), last = max(a.xyz, max(b.xyz, c.xyz));
    bool usable = (floatBitsToUint(b.w) & BVH_UNUSABLE) == 0u;
    uint primitive = floatBitsToUint(a.w);
#endif
    precise vec3 centre = (first * 0.5 + last * 0.5 - low) / max(high - low, 1e-30);
    uvec3 cell = uvec3(clamp(usable ? centre * 1024.0 : vec3(0.0), 0.0, 1023.0));
    uint code = spread(cell.x) << 2u | spread(cell.y) << 1u | spread(cell.z);
    pairs[push.step.z + i] = uvec2(usable ? code : (1u << CODE_BITS) - 1u, primitive);
}
#endif

#ifdef ORDER
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < push.mesh.z) {
        bvh_triangles[3u * (push.mesh.y + i)].w = uintBitsToFloat(pairs[push.step.z + i].y);
    }
}
#endif

#ifdef BOXES
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.step.y) {
        return;
    }
    vec3 low = uintBitsToFloat(uvec3(0x7F800000u)), high = -low;
    if (i < push.mesh.z) {
#ifdef UPPER
        uint at = 2u * slots[pairs[push.step.z + i].y].y;
        low = bvh_nodes[at].xyz;
        high = bvh_nodes[at + 1u].xyz;
#else
        uint at = 3u * (push.mesh.y + i);
        vec3 a = bvh_triangles[at].xyz, c = bvh_triangles[at + 2u].xyz;
        vec4 b = bvh_triangles[at + 1u];
        if ((floatBitsToUint(b.w) & BVH_UNUSABLE) == 0u) {
            low = min(a, min(b.xyz, c));
            high = max(a, max(b.xyz, c));
        }
#endif
    }
    halves[2u * (push.step.y + i)] = vec4(low, 0.0);
    halves[2u * (push.step.y + i) + 1u] = vec4(high, 0.0);
}
#endif

#ifdef HALVES
void main() {
    if (gl_GlobalInvocationID.x >= push.step.x) {
        return;
    }
    uint at = 2u * (push.step.x + gl_GlobalInvocationID.x);
    halves[at] = min(halves[2u * at], halves[2u * at + 2u]);
    halves[at + 1u] = max(halves[2u * at + 1u], halves[2u * at + 3u]);
}
#endif

#ifdef NODES
uint code_of(int triangle) { return pairs[push.step.z + uint(triangle)].x >> (CODE_BITS - push.mesh.w); }

// How many leading bits triangles i and j share; bits of their places follow those of their codes. -1 for what is none.
int shared_bits(int i, int j) {
    if (j < 0 || j >= int(push.mesh.z)) {
        return -1;
    }
    uint differ = code_of(i) ^ code_of(j);
    return differ != 0u ? 31 - findMSB(differ) : 63 - findMSB(uint(i ^ j));
}

void write_child(uint node, uint side, uint code, vec3 low, vec3 high) {
    bvh_nodes[4u * node + 2u * side] = vec4(low, uintBitsToFloat(code));
    bvh_nodes[4u * node + 2u * side + 1u] = vec4(high, 0.0);
}

void write_nothing(uint node, uint side) {
    vec3 inside_out = uintBitsToFloat(uvec3(0x7F800000u));
    write_child(node, side, BVH_NO_CHILD, inside_out, -inside_out);
}

// The child of triangles first..last: a leaf, or node `inner`.
void write_range(uint node, uint side, uint first, uint last, uint inner) {
    vec3 low = uintBitsToFloat(uvec3(0x7F800000u)), high = -low;
    for (uint l = push.step.y + first, r = push.step.y + last + 1u; l < r; l >>= 1u, r >>= 1u) {
        if ((l & 1u) != 0u) {
            low = min(low, halves[2u * l].xyz);
            high = max(high, halves[2u * l + 1u].xyz);
            ++l;
        }
        if ((r & 1u) != 0u) {
            --r;
            low = min(low, halves[2u * r].xyz);
            high = max(high, halves[2u * r + 1u].xyz);
        }
    }
    bool leaf = last - first < LEAF_LARGEST;
#ifdef UPPER
    uint primitive = pairs[push.step.z + first].y, code = BVH_LEAF | primitive;
    if (leaf) {
        slots[primitive].y = 2u * node + side;
    }
#else
    uint code = BVH_LEAF | (last - first) << BVH_COUNT_SHIFT | (push.mesh.y + first);
#endif
    write_child(node, side, leaf ? code : push.mesh.x + inner, low, high);
}

void main() {
    int i = int(gl_GlobalInvocationID.x), count = int(push.mesh.z);
    if (i >= max(count - 1, 1)) {
        return;
    }
    uint node = push.mesh.x + uint(i);
    if (count <= int(LEAF_LARGEST)) {
        if (i == 0) {
            write_range(node, 0u, 0u, uint(count) - 1u, 0u);
        } else {
            write_nothing(node, 0u);
        }
        write_nothing(node, 1u);
        return;
    }
    // To which side the node's range leads from triangle i, and how far: while more bits are shared than on the other side.
    int way = shared_bits(i, i + 1) > shared_bits(i, i - 1) ? 1 : -1, least = shared_bits(i, i - way);
    int reach = 2;
    while (shared_bits(i, i + reach * way) > least) {
        reach *= 2;
    }
    int far = 0;
    for (int part = reach / 2; part >= 1; part /= 2) {
        if (shared_bits(i, i + (far + part) * way) > least) {
            far += part;
        }
    }
    if (far < int(LEAF_LARGEST)) {
        write_nothing(node, 0u);
        write_nothing(node, 1u);
        return;
    }
    int other = i + far * way, own = shared_bits(i, other), near = 0;
    for (int part = far; part > 1;) {
        part = (part + 1) / 2;
        if (shared_bits(i, i + (near + part) * way) > own) {
            near += part;
        }
    }
    // An inner child has the number of the triangle beside the split.
    uint split = uint(i + near * way + min(way, 0));
    write_range(node, 0u, uint(min(i, other)), split, split);
    write_range(node, 1u, split + 1u, uint(max(i, other)), split + 1u);
}
#endif
