"""Study: bindless textures of OpenGL. A handle of 64 bits lies in a buffer, and the shader makes a sampler of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.images.palette import id_color
from common.lessons import Study
from common.scene import Sampler
from common.settings import knob

STUDY = Study(
    title="texture handles",
    idea="Where a texture is a number in a buffer, nothing is bound between draws, and so one call can make them all.",
    order=4,
    features=("bindless/gl-texture-handles",),
)

EXTENSION = "GL_ARB_bindless_texture"
"""What the driver must offer for handles; most on hardware do, Mesa's software driver does not."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    way: str = knob("handles", "how a draw gets its texture", choices=("handles", "units"))


ACROSS, DOWN = 4, 3
COUNT = ACROSS * DOWN
"""Rectangles, each with a texture of its own."""

INDICES = np.array([0, 1, 2, 2, 1, 3], np.uint32)
SHADERS = ("studies/texture_handles/quad.vert", "studies/texture_handles/quad.frag")
SMOOTH = Sampler("linear", "linear", None, "repeat", "clamp")


def defines(settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return what the shaders are told."""
    return (("ACROSS", ACROSS), ("DOWN", DOWN), ("HANDLES", int(settings.way == "handles")))


def textures() -> list[np.ndarray]:
    """Return 12 textures (H, W, 4) uint8, no two of one size: layers of one array could not hold them.

    Each is a disc in a colour of its own on stripes, as many as its number.
    """
    images = []
    for number in range(COUNT):
        height, width = 16 + 3 * number, 48 - 2 * number
        y, x = np.meshgrid(
            (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij"
        )
        color = id_color(np.array(number))
        stripes = 0.35 + 0.25 * (np.floor(x * 2 * (number + 1)) % 2)[..., None] * np.ones(3)
        disc = (np.hypot(x - 0.5, y - 0.5) < 0.35)[..., None]
        pixels = np.concatenate([np.where(disc, color, stripes), np.ones((height, width, 1))], axis=-1)
        images.append(np.rint(255.0 * pixels).astype(np.uint8))
    return images
