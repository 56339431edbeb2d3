"""The study procedural-spheres on Vulkan: boxes and a pipeline with an intersection shader, or a kernel."""

from __future__ import annotations

from ...frames.vulkan import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Described
from ...pipelines.ray_description import HitGroup, RayDescription
from ...pipelines.vulkan_descriptors import Held
from ...rays.vulkan_geometry import BoxGeometry
from ..rays_vulkan import RayStage
from . import CLOSEST, INTERSECTION, KERNEL, MISS, RAYGEN, STUDY, Settings, boxes, defines, spheres, told


class Renderer(RayStage):
    """A field of spheres."""

    study = STUDY
    settings_class: type = Settings

    def describe(self) -> Described:
        """Return a ray pipeline with one hit group of three stages, or the kernel."""
        macros = defines(self.settings)
        if not self.traces:
            return ComputeDescription(KERNEL, macros, name="spheres")
        group = HitGroup(CLOSEST, "", INTERSECTION)
        return RayDescription(
            RAYGEN, (MISS,), (group,), defines=(("RAYS_PIPELINE", 1), *macros), name="spheres"
        )

    def hold(self) -> dict[int, Held]:
        """Upload the spheres, and build the structure over their boxes."""
        places = spheres(self.settings)
        self.number = len(places)
        held: dict[int, Held] = {3: self.filled(places, ["storage"], "spheres")}
        if self.traces:
            _, address = self.input(boxes(places), "boxes")
            held[4] = self.world([BoxGeometry(address, len(places), "spheres")], [0])
        return held

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how often a sphere was asked, after a wait for the frame."""
        return told(self.counted())
