"""The study sine-hash on OpenGL: a picture that is all fragment shader."""

from __future__ import annotations

import numpy as np

from common.view.camera import View

from ..full_screen_gl import FullScreen
from . import STUDY, UNIFORM_BYTES, Settings, uniforms


class Renderer(FullScreen):
    """Two kinds of noise beside each other."""

    study = STUDY
    settings_class: type = Settings
    fragment = "sine_hash/noise.frag"
    uniform_bytes = UNIFORM_BYTES

    def uniforms(self, view: View, time: float) -> np.ndarray:
        """Return what the shader reads in this frame."""
        return uniforms(self.settings, self.size)
