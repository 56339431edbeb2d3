"""Studies that fill the picture with one triangle and do the rest in a fragment shader: a ray for each pixel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from common.environment import Environment
from common.scene import Sampler
from common.view.camera import Orthographic, View

AROUND = Sampler(mipmap=None, wrap_u="repeat", wrap_v="clamp")
"""How a panorama is read: its left edge meets its right one, its top row is the zenith."""


def rays(view: View, aspect: float) -> np.ndarray:
    """Return `Rays` of full_screen.glsl, (24,) float32: origins, then directions, each as middle, by x, by y."""
    clip = view.clip_from_view(aspect)
    right, up, back = view.world_from_view[:3, :3].T
    # What the projection divides by. Row 0 is on top: its scale of y is negative, and so is this.
    by_x, by_y = right / clip[0, 0], up / clip[1, 1]
    none = np.zeros(3)
    if isinstance(view.projection, Orthographic):
        rows = [view.eye, by_x, by_y, -back, none, none]
    else:
        rows = [view.eye, none, none, -back, by_x, by_y]
    return np.pad(np.array(rows), ((0, 0), (0, 1))).astype(np.float32).ravel()


class FullScreen(ABC):
    """What both backends ask of such a study."""

    settings: Any
    size: tuple[int, int]
    fragment: str  # file of its fragment shader, from the folder of the studies
    uniform_bytes: int

    @abstractmethod
    def uniforms(self, view: View, time: float) -> np.ndarray:
        """Return what the shader reads in this frame, float32."""

    def panorama(self) -> Environment | None:
        """Return what the shader reads as `panorama`; None where it reads nothing."""
        return None


def texels(panorama: Environment) -> np.ndarray:
    """Return a panorama as (H, 2H, 4) float32: three channels are a format that few devices can sample."""
    return np.pad(panorama.radiance, ((0, 0), (0, 0), (0, 1)))
