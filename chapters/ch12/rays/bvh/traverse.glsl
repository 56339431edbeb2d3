// Traversal of the hierarchy that rays/bvh/ builds: instances above, triangles of meshes below. bvh/model.py lays out the
// records. A pass may place the three buffers by the macros BVH_*_AT.

#include "watertight.glsl"
#include "slabs.glsl"
#include "rays/ray.glsl"

#ifndef BVH_NODES_AT
#define BVH_NODES_AT BIND(2, 0, 0)
#define BVH_TRIANGLES_AT BIND(2, 1, 1)
#define BVH_INSTANCES_AT BIND(2, 2, 2)
#endif

struct BvhInstance {
    vec4 object_from_world[3];  // rows
    uvec4 what;                 // node at which the mesh begins, mask, id, flags
    vec4 centre;                // of the mesh's box, in object space
    vec4 extent;
};

layout(BVH_NODES_AT, std430) readonly buffer Bvh_nodes_ { vec4 bvh_nodes[]; };
layout(BVH_TRIANGLES_AT, std430) readonly buffer Bvh_triangles_ { vec4 bvh_triangles[]; };
layout(BVH_INSTANCES_AT, std430) readonly buffer Bvh_instances_ {
    uvec4 bvh_root;  // x: the node at which the upper level begins
    vec4 bvh_centre;  // of the box around all instances
    vec4 bvh_extent;
    BvhInstance bvh_instances[];
};

#ifdef NON_OPAQUE
#include "rays/accept.glsl"
#endif
#ifdef STEPS
uint bvh_steps = 0u;  // nodes and leaves of the last trace
#endif

Hit bvh_traverse(Ray ray, uint mask, bool any) {
    Hit hit = Hit(ray.t_max, NO_HIT, 0u, vec2(0.0), 0u);
    SlabRay world_slabs = slab_ray(ray.origin, ray.direction, bvh_centre.xyz, bvh_extent.xyz), slabs = world_slabs;
    ShearedRay sheared_ = sheared_ray(ray.origin, ray.direction);
    uint stack[BVH_STACK];
    uint size = 0u;
    uint floor_ = BVH_NO_CHILD;  // the stack's size at which the instance ends; none in the upper level
    uint instance = 0u, flags = 0u;
    uint code = bvh_root.x;
    bool going = true;
#ifdef STEPS
    bvh_steps = 0u;
#endif
    while (going) {
        bool pop = true;
#ifdef STEPS
        ++bvh_steps;
#endif
        if ((code & BVH_LEAF) == 0u) {
            uint at = code * 4u;
            vec4 low0 = bvh_nodes[at], high0 = bvh_nodes[at + 1u], low1 = bvh_nodes[at + 2u], high1 = bvh_nodes[at + 3u];
            vec2 span0 = slab_interval(slabs, low0.xyz, high0.xyz, ray.t_min, hit.t);
            vec2 span1 = slab_interval(slabs, low1.xyz, high1.xyz, ray.t_min, hit.t);
            uint child0 = floatBitsToUint(low0.w), child1 = floatBitsToUint(low1.w);
            bool hit0 = span0.x <= span0.y, hit1 = span1.x <= span1.y;
            bool swap = hit1 && (!hit0 || span1.x < span0.x);
            code = swap ? child1 : child0;
            pop = !(hit0 || hit1);
            if (hit0 && hit1) {
                stack[size] = swap ? child0 : child1;
                ++size;
            }
        } else if (floor_ == BVH_NO_CHILD) {
            instance = code & ((1u << BVH_COUNT_SHIFT) - 1u);
            BvhInstance record = bvh_instances[instance];
            if ((record.what.y & mask) != 0u) {
                vec4 point = vec4(ray.origin, 1.0);
                vec3 origin = vec3(
                    dot(record.object_from_world[0], point), dot(record.object_from_world[1], point),
                    dot(record.object_from_world[2], point));
                vec3 direction = vec3(
                    dot(record.object_from_world[0].xyz, ray.direction), dot(record.object_from_world[1].xyz, ray.direction),
                    dot(record.object_from_world[2].xyz, ray.direction));
                slabs = slab_ray(origin, direction, record.centre.xyz, record.extent.xyz);
                sheared_ = sheared_ray(origin, direction);
                code = record.what.x;
                instance = record.what.z;
                flags = record.what.w;
                floor_ = size;
                pop = false;
            }
        } else {
            uint first = code & ((1u << BVH_COUNT_SHIFT) - 1u);
            uint end = first + (code >> BVH_COUNT_SHIFT & 3u) + 1u;
            for (uint triangle = first; triangle < end; ++triangle) {
                vec4 a = bvh_triangles[3u * triangle], b = bvh_triangles[3u * triangle + 1u];
                vec4 c = bvh_triangles[3u * triangle + 2u];
                float t;
                vec2 at;
                bool back;
                if (hits_triangle(sheared_, a.xyz, b.xyz, c.xyz, t, at, back) && t > ray.t_min && t < hit.t) {
                    Hit candidate = Hit(t, instance, floatBitsToUint(a.w), at, back ? HIT_BACK : 0u);
#ifdef NON_OPAQUE
                    if ((flags & BVH_NON_OPAQUE) == 0u || accept(candidate)) {
                        hit = candidate;
                    }
#else
                    hit = candidate;
#endif
                }
            }
            going = !(any && hit.instance != NO_HIT);
        }
        if (pop && going) {
            going = size > 0u;
            if (size == floor_) {
                floor_ = BVH_NO_CHILD;
                slabs = world_slabs;
            }
            if (going) {
                --size;
                code = stack[size];
            }
        }
    }
    return hit;
}

Hit trace(Ray ray, uint mask) { return bvh_traverse(ray, mask, false); }

bool occluded(Ray ray, uint mask) { return bvh_traverse(ray, mask, true).instance != NO_HIT; }
