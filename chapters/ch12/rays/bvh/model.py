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
        ("spare", np.uint32),
    ]
)
"""48 bytes: corners in object space, and the triangle's number in its mesh's index list."""

INSTANCE = np.dtype(
    [
        ("object_from_world", np.float32, (3, 4)),
        ("root", np.uint32),
        ("mask", np.uint32),
        ("id", np.uint32),
        ("flags", np.uint32),
        ("centre", np.float32, 4),
        ("extent", np.float32, 4),
    ]
)
"""96 bytes. `root` is the node at which the mesh begins; centre and half extent are those of its box, in object space."""

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

DEPTH_LARGEST = 32
"""Of nodes above one another in either level. A traversal keeps one code for each node on its way, of both levels."""
STACK = 2 * DEPTH_LARGEST

CONSTANTS = {
    "BVH_LEAF": f"{LEAF}u",
    "BVH_COUNT_SHIFT": f"{COUNT_SHIFT}u",
    "BVH_NO_CHILD": f"{NO_CHILD}u",
    "BVH_NON_OPAQUE": f"{NON_OPAQUE}u",
    "BVH_STACK": STACK,
}
"""Constants of the shaders, to be given as defines."""


def leaf_code(first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the codes of leaves of `count` (1 to 4) triangles from `first` on."""
    return (LEAF | (count - 1) << COUNT_SHIFT | first).astype(np.uint32)
