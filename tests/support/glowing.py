"""A rectangle that glows as an image says: pictures of any luminance, texel by texel."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.scene import Image, Material, Scene
from tests.support.scenes import quad_scene, texture

BLACK = (0.0, 0.0, 0.0, 1.0)


def glowing(nits: np.ndarray) -> Scene:
    """Return a black rectangle with emission (H, W, 3) or (H, W) in nits, which nothing lights.

    In a picture of W x H pixels the view `facing()` shows a texel at each pixel.
    """
    rgb = np.broadcast_to(nits[..., None] if nits.ndim == 2 else nits, (*nits.shape[:2], 3))
    largest = float(rgb.max()) or 1.0
    texels = np.concatenate([rgb / largest, np.ones((*rgb.shape[:2], 1))], -1).astype(np.float32)
    material = Material(
        base_color=BLACK, metallic=1.0, emissive=(largest,) * 3, emissive_texture=texture(0), roughness=1.0
    )
    wide = np.diag([rgb.shape[1] / rgb.shape[0], 1.0, 1.0, 1.0])
    return quad_scene(material, images=(Image("glow", texels),), matrices=(wide,))


def glow_of(nits: float) -> Material:
    """Return a black material that emits `nits` in all channels."""
    return Material(base_color=BLACK, metallic=1.0, emissive=(nits,) * 3)


def exposure_of(renderer: Any, frame: Any) -> float:
    """Return the exposure of a frame whose slot was not used again, after waiting for it."""
    _ = frame.timings
    return float(renderer._data.exposures.of_frame(frame._slot.index, float("nan")))
