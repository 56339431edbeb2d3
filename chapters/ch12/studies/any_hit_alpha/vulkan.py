"""The study any-hit-alpha on Vulkan: a pipeline with an any-hit shader, or a kernel over our own hierarchy."""

from __future__ import annotations

import numpy as np

from ...frames.vulkan import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Described
from ...pipelines.ray_description import HitGroup, RayDescription
from ...pipelines.vulkan_descriptors import Held
from ...rays.groups import CLOSEST, MISSES
from ...rays.model import CULL_DISABLE, FORCE_NO_OPAQUE, FORCE_OPAQUE
from ...rays.vulkan_geometry import MeshGeometry
from ..rays_vulkan import RayStage
from . import ANY, KERNEL, RAYGEN, STUDY, Settings, defines, hierarchy, mask_words, meshes, normals, told


class Renderer(RayStage):
    """Leaves above a ground."""

    study = STUDY
    settings_class: type = Settings

    def describe(self) -> Described:
        """Return a ray pipeline whose hit group has an any-hit shader, or the kernel."""
        if not self.traces:
            return ComputeDescription(KERNEL, defines(False), name="leaves")
        return RayDescription(RAYGEN, MISSES, (HitGroup(CLOSEST, ANY),), defines=defines(True), name="leaves")

    def hold(self) -> dict[int, Held]:
        """Upload mask and normals, and build the structures of leaves and ground."""
        held: dict[int, Held] = {
            3: self.filled(mask_words(), ["storage"], "mask"),
            4: self.filled(normals(self.settings), ["storage"], "normals"),
        }
        if not self.traces:
            parts = enumerate(hierarchy(self.settings), 5)
            return held | {number: self.filled(part, ["storage"], "hierarchy") for number, part in parts}
        geometries, lists, end = [], [], 2
        for name, (positions, indices) in zip(("leaves", "ground"), meshes(self.settings), strict=True):
            _, vertices = self.input(positions, f"positions of {name}")
            _, listed = self.input(indices, f"indices of {name}")
            geometries.append(MeshGeometry(vertices, len(positions), listed, len(indices), name))
            lists.append((end, np.arange(len(indices))))
            end += len(indices)
        leaves = FORCE_OPAQUE if self.settings.opaque else FORCE_NO_OPAQUE
        held[5] = self.world(geometries, [leaves | CULL_DISABLE, FORCE_OPAQUE | CULL_DISABLE])
        # Triangles of the structures have the order of the lists of indices (rays/world.glsl).
        order = np.concatenate([[begin for begin, _ in lists], *(numbers for _, numbers in lists)])
        held[6] = self.filled(order.astype(np.uint32), ["storage"], "order of triangles")
        return held

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how often the mask was asked, after a wait for the frame."""
        return told(self.counted())
