"""The study dithered-alpha on OpenGL: a picture that is all fragment shader."""

from __future__ import annotations

import numpy as np

from common.view.camera import View

from ..full_screen_gl import FullScreen
from . import STUDY, UNIFORM_BYTES, Settings, uniforms


class Renderer(FullScreen):
    """A sheet of growing alpha."""

    study = STUDY
    settings_class: type = Settings
    fragment = "dithered_alpha/ramp.frag"
    uniform_bytes = UNIFORM_BYTES

    def uniforms(self, view: View, time: float) -> np.ndarray:
        """Return what the shader reads in this frame."""
        return uniforms(self.settings)
