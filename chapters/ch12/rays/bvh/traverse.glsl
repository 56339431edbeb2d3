// Traversal of the hierarchy that rays/bvh/ builds: instances above, triangles of meshes below. bvh/model.py lays out the
// records.
//
// NON_OPAQUE: what includes this has a function `bool accept(Hit)`, which decides on candidates in instances of that flag;
// candidates come in any order, each once. STEPS: `bvh_steps` counts.

#include "watertight.glsl"
#include "slabs.glsl"
#include "rays/ray.glsl"
#include "rays/bvh/records.glsl"

const uint BVH_PASSED = BVH_LEAF - 1u;  // in the place of a node's number: a hit in front of that box was found since

// Takes up what was put off last. Where that is above the instance, the ray is in the world again; without any, the end.
#define BVH_POP \
    if (size == floor_) { \
        floor_ = BVH_NO_CHILD; \
        slabs = world_slabs; \
    } \
    if (size > 0u) { \
        --size; \
        code = bvh_begins[size] < hit.t ? bvh_stack[size] : BVH_PASSED; \
    } else { \
        code = BVH_NO_CHILD; \
    }

#ifdef STEPS
#define BVH_STEP ++bvh_steps;
#else
#define BVH_STEP
#endif

// What is put off, and where the ray enters its box. Not inside of the function: a driver of OpenGL cleared them at each call,
// which took most of the time.
uint bvh_stack[BVH_STACK];
float bvh_begins[BVH_STACK];

#ifdef STEPS
uint bvh_steps = 0u;  // nodes and leaves of the last trace
#endif

// Boxes below node `root` seen along a ray: of that node they are the largest, and all that its pad depends on.
SlabRay bvh_slabs(uint root, vec3 origin, vec3 direction, float roundings) {
    vec3 low = min(bvh_nodes[4u * root].xyz, bvh_nodes[4u * root + 2u].xyz);
    vec3 high = max(bvh_nodes[4u * root + 1u].xyz, bvh_nodes[4u * root + 3u].xyz);
    bool empty = any(greaterThan(low, high));
    return slab_ray(
        origin, direction, empty ? vec3(0.0) : 0.5 * low + 0.5 * high, empty ? vec3(0.0) : 0.5 * high - 0.5 * low, roundings);
}

Hit bvh_traverse(Ray ray, uint mask, uint sides, bool any) {
    Hit hit = Hit(ray.t_max, NO_HIT, 0u, vec2(0.0), 0u);
    if (bvh_head.y == 0u) {
        return hit;
    }
    // Instances see the ray in their own space, with roundings of two matrices.
    SlabRay world_slabs = bvh_slabs(bvh_head.x, ray.origin, ray.direction, 32.0), slabs = world_slabs;
    ShearedRay sheared_ = sheared_ray(ray.origin, ray.direction);
    uint size = 0u;
    uint floor_ = BVH_NO_CHILD;  // the stack's size at which the instance ends; none in the upper level
    uint instance = 0u, flags = 0u, skipped = 0u;
    uint code = bvh_head.x;
    bool going = true;
#ifdef STEPS
    bvh_steps = 0u;
#endif
    while (going) {
        // All lanes of a processor do the same at a time: first all find leaves, and then all look into theirs (Aila and
        // Laine 2009, "Understanding the Efficiency of Ray Traversal on GPUs").
        while ((code & BVH_LEAF) == 0u) {
            BVH_STEP
            if (code == BVH_PASSED) {
                BVH_POP
                continue;
            }
            uint at = code * 4u;
            vec4 low0 = bvh_nodes[at], high0 = bvh_nodes[at + 1u], low1 = bvh_nodes[at + 2u], high1 = bvh_nodes[at + 3u];
            vec2 span0 = slab_interval(slabs, low0.xyz, high0.xyz, ray.t_min, hit.t);
            vec2 span1 = slab_interval(slabs, low1.xyz, high1.xyz, ray.t_min, hit.t);
            uint child0 = floatBitsToUint(low0.w), child1 = floatBitsToUint(low1.w);
            bool hit0 = span0.x <= span0.y, hit1 = span1.x <= span1.y;
            bool swap = hit1 && (!hit0 || span1.x < span0.x);
            code = swap ? child1 : child0;
            if (hit0 && hit1) {
                bvh_stack[size] = swap ? child0 : child1;
                bvh_begins[size] = swap ? span0.x : span1.x;
                ++size;
            }
            if (!(hit0 || hit1)) {
                BVH_POP
            }
        }
        BVH_STEP
        bool pop = true;
        if (code == BVH_NO_CHILD) {  // the end; a ray of NaN may come to a child that is none, too
            going = false;
        } else if (floor_ == BVH_NO_CHILD) {
            instance = code & ((1u << BVH_COUNT_SHIFT) - 1u);
            BvhInstance record = bvh_instances[instance];
            if ((record.what.y & mask) != 0u) {
                vec3 away = ray.origin - vec3(record.rows[0].w, record.rows[1].w, record.rows[2].w);
                mat3 rows = mat3(record.rows[0].xyz, record.rows[1].xyz, record.rows[2].xyz);
                vec3 origin = away * rows, direction = ray.direction * rows;
                slabs = bvh_slabs(record.what.x, origin, direction, 12.0);
                sheared_ = sheared_ray(origin, direction);
                code = record.what.x;
                instance = record.what.z;
                flags = record.what.w;
                skipped = (flags & BVH_TWO_SIDED) != 0u ? 0u : sides;
                floor_ = size;
                pop = false;
            }
        } else {
            uint first = code & ((1u << BVH_COUNT_SHIFT) - 1u);
            uint end = first + (code >> BVH_COUNT_SHIFT & 3u) + 1u;
            for (uint triangle = first; triangle < end; ++triangle) {
                vec4 a = bvh_triangles[3u * triangle], b = bvh_triangles[3u * triangle + 1u];
                vec4 c = bvh_triangles[3u * triangle + 2u];
                float t = 0.0;
                vec2 at = vec2(0.0);
                bool back = false;
                // The side is no part of the same condition: a driver then asked for it before it was known.
                bool found = hits_triangle(sheared_, a.xyz, b.xyz, c.xyz, t, at, back);
                uint side = back ? SKIP_BACKS : SKIP_FRONTS;
                if (found && t > ray.t_min && t < hit.t && (skipped & side) == 0u) {
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
            BVH_POP
        }
    }
    return hit;
}

Hit trace(Ray ray, uint mask, uint sides) { return bvh_traverse(ray, mask, sides, false); }

bool occluded(Ray ray, uint mask, uint sides) { return bvh_traverse(ray, mask, sides, true).instance != NO_HIT; }
