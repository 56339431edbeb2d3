"""The study any-hit-alpha on OpenGL: a kernel over our own hierarchy."""

from __future__ import annotations

from backends.gl.resources import Buffer

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Described
from ..rays_gl import RayStage
from . import KERNEL, STUDY, Settings, defines, hierarchy, mask_words, normals, told


class Renderer(RayStage):
    """Leaves above a ground."""

    study = STUDY
    settings_class: type = Settings

    def describe(self) -> Described:
        """Return the kernel."""
        return ComputeDescription(KERNEL, defines(False), name="leaves")

    def hold(self) -> dict[int, Buffer]:
        """Upload mask, normals and the hierarchy."""
        parts = enumerate(hierarchy(self.settings), 5)
        held = {number: self.filled(part, "hierarchy") for number, part in parts}
        return {
            3: self.filled(mask_words(), "mask"),
            4: self.filled(normals(self.settings), "normals"),
            **held,
        }

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how often the mask was asked, after a wait for the frame."""
        return told(self.counted())
