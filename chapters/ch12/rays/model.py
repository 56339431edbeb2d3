"""What structures know of the instances of a scene: masks, flags, and the table from which records are written."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError
from common.scene import Scene

SURFACES, BLENDED, UNLIT = 1, 2, 4
"""Bits of an instance's mask: ordinary surfaces, those that let light through, and those that show pictures, as a sky
around the scene does. A hidden instance has no bit."""

MOST_INSTANCES = 1 << 24
"""A record has 24 bits for the number of its instance."""

CULL_DISABLE, FORCE_OPAQUE, FORCE_NO_OPAQUE = 1, 4, 8
"""Flags of a record (VkGeometryInstanceFlagBitsKHR). A triangle is seen from its front where its corners run
counter-clockwise in right-handed object space, as in glTF. The flag TRIANGLE_FLIP_FACING has a second name with "front
counter-clockwise" in it, which speaks of left-handed space."""


def check_count(count: int, most: int = MOST_INSTANCES) -> None:
    """Raise SceneError for more instances than structures can have; `most` is a limit of the device."""
    most = min(most, MOST_INSTANCES)
    if count > most:
        raise SceneError(
            f"This scene has {count} instances, and rays of this device tell {most} apart: merge some of its meshes."
        )


def opaque_materials(scene: Scene) -> NDArray[np.bool_]:
    """Return (M,) whether no ray passes through surfaces of a material."""
    return np.array([material.alpha_mode == "opaque" for material in scene.materials], bool)


def two_sided(scene: Scene) -> NDArray[np.bool_]:
    """Return (M,) whether both sides of a material are seen; of the others rays may skip a side."""
    return np.array([material.double_sided for material in scene.materials], bool)


def masks(scene: Scene, hidden: bool = False) -> NDArray[np.uint32]:
    """Return (I,) the mask of each instance; with `hidden` those of hidden ones as if they were visible."""
    bits = [
        UNLIT if material.unlit else BLENDED if material.alpha_mode == "blend" else SURFACES
        for material in scene.materials
    ]
    of_instance = np.array(bits, np.uint32)[scene.meshes["material"][scene.instances.mesh]]
    return np.where(scene.instances.visible | hidden, of_instance, 0).astype(np.uint32)


def instance_table(
    scene: Scene, addresses: Mapping[int, int], order: NDArray[np.integer]
) -> NDArray[np.uint32]:
    """Return (I, 4) words in the order of the records: address (low, high), instance, mask and flags.

    `addresses` has the structure of each mesh; an instance of a mesh without one is not hit by any ray.
    """
    of_mesh = np.zeros(len(scene.meshes), np.uint64)
    for mesh, address in addresses.items():
        of_mesh[mesh] = address
    instances = scene.instances
    of_material = np.where(opaque_materials(scene), FORCE_OPAQUE, FORCE_NO_OPAQUE)
    of_material |= np.where(two_sided(scene), CULL_DISABLE, 0)
    flags = of_material.astype(np.uint32)[scene.meshes["material"][instances.mesh]]
    of_instance = of_mesh[instances.mesh]
    table = np.zeros((len(instances), 4), np.uint32)
    table[:, 0] = of_instance & np.uint64(0xFFFFFFFF)
    table[:, 1] = of_instance >> np.uint64(32)
    table[:, 2] = np.arange(len(instances))
    table[:, 3] = masks(scene) | flags << np.uint32(8)
    return table[order]


def order_words(scene: Scene, orders: Mapping[int, NDArray[np.uint32]]) -> NDArray[np.uint32]:
    """Return the words of `ray_order` (rays/world.glsl): for each instance where its list begins, then the lists.

    `orders` has, by mesh, the numbers of its triangles in the order of its structure.
    """
    begins = np.zeros(len(scene.meshes), np.uint32)
    end = len(scene.instances)
    for mesh, order in orders.items():
        begins[mesh] = end
        end += len(order)
    return np.concatenate([begins[scene.instances.mesh], *orders.values()]).astype(np.uint32)
