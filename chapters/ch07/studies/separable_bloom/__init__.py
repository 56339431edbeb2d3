"""Study: bloom as the cookbook has it, a bright pass at 256x256 and four blurs along rows and columns.

A Gaussian blur of radius 5 over a square takes 121 texels for each texel. Its weights are products of a factor for the
row and one for the column, so two passes of 11 texels give the same sum. Repeated blurs add their variances: four of
them are as wide as one of twice the standard deviation.

    bright pass -> 4 x (blur along x, blur along y) -> picture + strength * bloom -> tone curve

Here the width is fixed in texels of a small picture. The pyramid of the chapter's frame reaches farther with fewer
texels: each level is twice as wide at a quarter of the cost.

Source: Kosarevsky and Latypov 2021, "3D Graphics Rendering Cookbook", chapter 8, with its weights of luminance and of
the blur. Light is added before the tone curve, and not after it, where the sum could exceed white.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="separable bloom",
    idea="Two passes of 11 texels blur a square of 121; four blurs are as wide as one with twice the deviation.",
    order=3,
    features=("hdr/bloom", "postprocess/separable-blur"),
)

SIDE = 256
"""Texels along an edge of the picture that is blurred."""

TAPS = (3, 6, 10, 15, 20, 25, 20, 15, 10, 6, 3)
"""Weights of the blur, over their sum of 133; the variance is 5.128 texels^2."""

KERNELS = {"bright": ("bright.comp", 0), "across": ("blur.comp", 0), "down": ("blur.comp", 1)}
"""The shader of each kernel, and the axis along which it blurs."""

FOLDER = "studies/separable_bloom"
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    repeats: int = knob(4, "blurs, each along both axes", minimum=0, maximum=64)
    threshold: float = knob(1.0, "weighted luminance from which a texel is bright", minimum=0, maximum=60000)
    strength: float = knob(1.1, "factor on the bloom", minimum=0, maximum=10)
    white: float = knob(1.17, "value that is shown as white", minimum=0.1, maximum=60000)


@dataclass
class BloomWork(Work):
    """The work of a frame: texels that its kernels `fetched`."""

    dispatches: int = 0
    fetched: int = 0


def defines(settings: Settings, axis: int = 0) -> tuple[tuple[str, int | float | str], ...]:
    """Return the macros of the shaders."""
    return (
        ("SIDE", SIDE),
        ("AXIS", axis),
        ("TAPS", ", ".join(f"{tap}.0" for tap in TAPS)),
        ("THRESHOLD", settings.threshold),
        ("STRENGTH", settings.strength),
        ("WHITE", settings.white),
    )


def order(settings: Settings) -> list[str]:
    """Return the kernels of a frame in order; each reads what the one before wrote."""
    return ["bright", *(["across", "down"] * settings.repeats)]


def work_of(settings: Settings) -> BloomWork:
    """Return the counters of a frame."""
    kernels = order(settings)
    fetched = SIDE * SIDE * (1 + len(TAPS) * (len(kernels) - 1))
    return BloomWork(draws=1, triangles=1, dispatches=len(kernels), fetched=fetched)


def picture() -> np.ndarray:
    """Return what is to glow, (SIDE, SIDE, 4) float32: lamps of all sizes and colours before a dim wall."""
    rng = np.random.default_rng(7)
    y, x = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE
    light = np.zeros((SIDE, SIDE, 4), np.float32)
    light[..., :3] = (0.05 + 0.35 * y)[..., None] * np.array([0.5, 0.45, 0.6])
    for _ in range(24):
        centre, radius = rng.uniform(0.1, 0.9, 2), 10.0 ** rng.uniform(-2.3, -1.4)
        inside = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 < radius**2
        light[inside, :3] = rng.uniform(0.3, 1.0, 3) * 10.0 ** rng.uniform(0.2, 1.5)
    return light
