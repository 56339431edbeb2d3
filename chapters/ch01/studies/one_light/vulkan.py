"""The study one-light on Vulkan: the study textured-mesh, one vertex stream more, and a lamp among its uniforms."""

from __future__ import annotations

import numpy as np

from common.view.camera import View

from ..textured_mesh.vulkan import Renderer as TexturedMesh
from . import STREAMS, STUDY, UNIFORM_BYTES, Settings, uniforms


class Renderer(TexturedMesh):
    """One object of a scene, at rest, lit by a lamp that goes around it."""

    study = STUDY
    settings_class: type = Settings
    folder = "one_light"
    streams = STREAMS
    uniform_bytes = UNIFORM_BYTES

    def uniforms(self, view: View, time: float) -> np.ndarray:
        """Return what the shaders read in this frame."""
        aspect = self.size[0] / self.size[1]
        return uniforms(self.scene, self._primitive, self.settings, view, time, aspect)
