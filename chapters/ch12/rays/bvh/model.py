"""The records that the traversal reads, laid out for storage buffers: nodes, triangles, instances.

A node has the boxes and codes of its two children, so that one fetch decides on both. A code is the index of a node, a
leaf (bit 31; the number of triangles less one in bits 29 and 30; the first triangle in the other 29), or NO_CHILD.
A leaf of the upper level holds one instance, whose record is numbered like a triangle.
"""

from __future__ import annotations

import numpy as np

NODE = np.dtype(
    [
        ("low0", np.float32, 3),
        ("child0", np.uint32),
        ("high0", np.float32, 3),
        ("spare0", np.uint32),
        ("low1", np.float32, 3),
        ("child1", np.uint32),
        ("high1", np.float32, 3),
        ("spare1", np.uint32),
    ]
)
"""64 bytes: four vec4."""

TRIANGLE = np.dtype(
    [
        ("a", np.float32, 3),
        ("primitive", np.uint32),
        ("b", np.float32, 3),
        ("flags", np.uint32),
        ("c", np.float32, 3),
        ("mesh", np.uint32),
    ]
)
"""48 bytes: corners in object space, the triangle's number in its mesh's index list, flags, and for refits the mesh."""

INSTANCE = np.dtype(
    [
        ("rows", np.float32, (3, 4)),
        ("root", np.uint32),
        ("mask", np.uint32),
        ("id", np.uint32),
        ("flags", np.uint32),
    ]
)
"""64 bytes. Each row has a row of the inverse of the instance's matrix, without translation, and one number of the
translation. That is subtracted from a point before the row multiplies it: far from the origin both may be large, and
their difference is not. `root` is the node at which the mesh begins."""

HEAD = np.dtype([("root", np.uint32), ("count", np.uint32), ("spare", np.uint32, 2)])
"""What stands before the records of instances: the node at which the upper level begins, and the number of records."""

SLOT = np.dtype([("instance", np.uint32), ("box", np.uint32), ("mask", np.uint32), ("flags", np.uint32)])
"""What the kernel that writes an instance's record knows of it: its place in the scene; where its box lies in the upper
level, twice the node and the child's number; its mask while it is visible; and the flags of its record."""

NODE_WORDS, TRIANGLE_WORDS, INSTANCE_WORDS = (kind.itemsize // 4 for kind in (NODE, TRIANGLE, INSTANCE))

LEAF = 1 << 31
COUNT_SHIFT = 29
LEAF_LARGEST = 4
NO_CHILD = 0xFFFFFFFF
"""Its box is inside out, so that no ray meets it."""
TRIANGLES_LARGEST = (1 << COUNT_SHIFT) - LEAF_LARGEST  # the code NO_CHILD is no leaf then
INSTANCES_LARGEST = 1 << 24

NON_OPAQUE = 1
"""Flag of an instance: hits ask `accept`."""

TWO_SIDED = 2
"""Flag of an instance: rays meet both sides of it, those that skip a side of other surfaces, too."""

UNUSABLE = 1
"""Flag of a triangle without area or with corners that are no numbers: its corners are zeros, and its leaf's box is
without it."""

DEPTH_UPPER, DEPTH_LARGEST = 32, 44
"""How many nodes stand above one another at most: where numpy builds (instances and meshes), and in a mesh that the GPU
built, whose levels are the bits of its codes and of the number of its triangles. A traversal keeps one code for each
node on its way through both levels."""
STACK = DEPTH_UPPER + DEPTH_LARGEST

CONSTANTS: dict[str, int | float | str] = {
    "BVH_LEAF": f"{LEAF}u",
    "BVH_COUNT_SHIFT": f"{COUNT_SHIFT}u",
    "BVH_NO_CHILD": f"{NO_CHILD}u",
    "BVH_NON_OPAQUE": f"{NON_OPAQUE}u",
    "BVH_TWO_SIDED": f"{TWO_SIDED}u",
    "BVH_UNUSABLE": f"{UNUSABLE}u",
    "BVH_STACK": STACK,
}
"""Constants of the shaders, to be given as defines."""


def leaf_code(first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the codes of leaves of `count` (1 to 4) triangles from `first` on."""
    return (LEAF | (count - 1) << COUNT_SHIFT | first).astype(np.uint32)
