// The three buffers of the hierarchy (bvh/model.py), at binding RAYS_BINDING of set RAYS_SET and the two behind it; in
// OpenGL at storage slot RAYS_SLOT and the two behind it. BVH_WRITTEN: by a kernel that writes them.

#ifndef RAYS_SET
#define RAYS_SET 2
#define RAYS_BINDING 0
#endif
#ifndef RAYS_SLOT
#define RAYS_SLOT RAYS_BINDING
#endif
#ifdef BVH_WRITTEN
#define BVH_ACCESS
#else
#define BVH_ACCESS readonly
#endif

struct BvhInstance {
    vec4 rows[3];  // of the inverse matrix, without translation; w: the translation, which leaves a point first
    uvec4 what;    // node at which the mesh begins, mask, id, flags
};

layout(BIND(RAYS_SET, RAYS_BINDING, RAYS_SLOT), std430) BVH_ACCESS buffer Bvh_nodes_ { vec4 bvh_nodes[]; };
layout(BIND(RAYS_SET, RAYS_BINDING + 1, RAYS_SLOT + 1), std430) BVH_ACCESS buffer Bvh_triangles_ { vec4 bvh_triangles[]; };
layout(BIND(RAYS_SET, RAYS_BINDING + 2, RAYS_SLOT + 2), std430) BVH_ACCESS buffer Bvh_instances_ {
    uvec4 bvh_head;  // the node at which the upper level begins, and the number of instances
    BvhInstance bvh_instances[];
};
