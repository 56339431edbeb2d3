"""The study burley-smith on OpenGL: a picture that is all fragment shader, and the irradiance of a sky."""

from __future__ import annotations

import numpy as np

from common.environment import Environment
from common.view.camera import View

from ..full_screen_gl import FullScreen
from . import STUDY, UNIFORM_BYTES, Settings, around, uniforms


class Renderer(FullScreen):
    """A chart of balls."""

    study = STUDY
    settings_class: type = Settings
    fragment = "burley_smith/balls.frag"
    uniform_bytes = UNIFORM_BYTES

    def panorama(self) -> Environment:
        """Return the light of the sky on every normal."""
        return around(self.settings)

    def uniforms(self, view: View, time: float) -> np.ndarray:
        """Return what the shader reads in this frame."""
        return uniforms(self.settings, self.size)
