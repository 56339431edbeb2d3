"""The study reflection-refraction on Vulkan: a picture that is all fragment shader, and the sky it looks into."""

from __future__ import annotations

import numpy as np

from common.environment import Environment
from common.view.camera import View

from ..full_screen_vulkan import FullScreen
from . import STUDY, UNIFORM_BYTES, Settings, around, uniforms


class Renderer(FullScreen):
    """A ball in a panorama."""

    study = STUDY
    settings_class: type = Settings
    fragment = "reflection_refraction/ball.frag"
    uniform_bytes = UNIFORM_BYTES

    def panorama(self) -> Environment:
        """Return what is seen of the world around the ball."""
        return around(self.settings)

    def uniforms(self, view: View, time: float) -> np.ndarray:
        """Return what the shader reads in this frame."""
        return uniforms(self.settings, view, self.size[0] / self.size[1])
