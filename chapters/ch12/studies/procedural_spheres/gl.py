"""The study procedural-spheres on OpenGL: a kernel that asks every sphere."""

from __future__ import annotations

from backends.gl.resources import Buffer

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Described
from ..rays_gl import RayStage
from . import KERNEL, STUDY, Settings, defines, spheres, told


class Renderer(RayStage):
    """A field of spheres."""

    study = STUDY
    settings_class: type = Settings

    def describe(self) -> Described:
        """Return the kernel."""
        return ComputeDescription(KERNEL, defines(self.settings), name="spheres")

    def hold(self) -> dict[int, Buffer]:
        """Upload the spheres."""
        places = spheres(self.settings)
        self.number = len(places)
        return {3: self.filled(places, "spheres")}

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how often a sphere was asked, after a wait for the frame."""
        return told(self.counted())
