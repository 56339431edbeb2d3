"""What frames of the bench of temporal anti-aliasing are held to: the same frames with 64 samples a pixel.

A reference is the mean of linear light over the 8x8 pixels of a larger picture, then the tone curve and the code of
sRGB, in double precision and not rounded to 8 bits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.images.color import encode_srgb
from common.reports.benches import Subject
from common.view.camera import exposure

from .taa_scenes import Case

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

SAMPLES = 8
"""Samples along each axis of a pixel."""


class Reference(NamedTuple):
    """One frame as it should be: (H, W, 3) what is shown, 0 to 1, and light; (H, W) whether the object covers it."""

    shown: Float64
    light: Float64
    covered: Bool | None


def box_mean(picture: ArrayLike, samples: int = SAMPLES) -> Float64:
    """Return the mean (H, W, ...) of each square of `samples` pixels along an axis, in double precision."""
    picture = np.asarray(picture)
    height, width = (length // samples for length in picture.shape[:2])
    squares = picture.reshape(height, samples, width, samples, *picture.shape[2:])
    return np.asarray(squares.mean(axis=(1, 3), dtype=np.float64))


def tone_neutral(color: ArrayLike) -> Float64:
    """Return the Khronos PBR Neutral tone curve (2024) of linear colours (..., 3)."""
    color = np.asarray(color, np.float64)
    start, desaturation = 0.8 - 0.04, 0.15
    darkest = color.min(axis=-1, keepdims=True)
    color = color - np.where(darkest < 0.08, darkest - 6.25 * darkest**2, 0.04)
    peak = color.max(axis=-1, keepdims=True)
    rest = 1.0 - start
    above = np.maximum(peak, start)  # what is below keeps its colour
    new_peak = 1.0 - rest**2 / (above + rest - start)
    gray = 1.0 - 1.0 / (desaturation * (above - new_peak) + 1.0)
    bright = color * (new_peak / above) * (1.0 - gray) + new_peak * gray
    return np.where(peak < start, color, bright)


def shown(light: ArrayLike) -> Float64:
    """Return the codes, 0 to 1, in which linear light (..., 3), times the exposure, is shown."""
    return encode_srgb(np.clip(tone_neutral(light), 0.0, 1.0))


def references(subject: Subject, case: Case, settings: Any, frames: int) -> list[Reference]:
    """Return the references of the first frames of a case; of one that does not move, its only one."""
    width, height = subject.size
    outputs = {"color_linear"} | ({"instance_id"} if case.passing is not None else set())
    found = []
    with subject.on(case.scene, (width * SAMPLES, height * SAMPLES)).open(settings, outputs) as renderer:
        first = subject.view(renderer)
        renderer.render(first)
        renderer.wait_loaded()
        for frame in range(frames if case.moves else 1):
            view = case.view(first, frame)
            drawn = renderer.render(view, case.time(frame))
            light = box_mean(drawn.image("color_linear")) * exposure(view.ev100)
            covered = None
            if case.passing is not None:
                # 0 is where nothing is drawn.
                covered = box_mean(drawn.image("instance_id") == case.passing + 1) > 0.0
            found.append(Reference(shown(light), light, covered))
    return found
