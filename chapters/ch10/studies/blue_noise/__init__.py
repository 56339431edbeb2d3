"""Study: how a ramp of light looks with one sample a texel, by white and by blue noise, in one frame and in many.

A sample is 1 where a number of the noise lies below the light, else 0; its mean is the light. A dithered code is the
light times `steps` plus noise from -1 to 1, rounded; the density of the noise is a triangle. Its numbers come from

    white   a hash of texel and frame: numbers of different texels and frames are independent
    turned  a rank from a table of white noise, plus the frame times the golden ratio, wrapped
    blue    the same with the table of blue noise, whose neighbours differ (common/numerics/blue_noise.py)

The picture has a pair of columns for each of them: an image, and the spectrum of its error, with the frequency 0 in the
middle. The rows are one frame and the mean of `frames` frames, of samples, of codes whose noise is the sum of two
numbers less 1, and of codes whose noise is one number, remapped by the inverse of the triangle's distribution.
Brightness of a spectrum is the logarithm of the power. The table of noise repeats after 128 texels, so a picture of
768 x 768 has a pixel for each.

Blue noise changes where in the spectrum an error lies, and not how large it is. The golden ratio changes how fast the
error of a texel falls with the number of frames: with their number, and not with its root. The sum of two tables is
less blue than a table; a table that is remapped keeps its spectrum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.stage import Work
from common.lessons import Study
from common.numerics.blue_noise import FRAMES, SIZE, ranks
from common.settings import knob

STUDY = Study(
    title="blue noise",
    idea="Blue noise moves the error of a sample to frequencies that the eye averages.",
    order=1,
    features=("noise/blue-noise", "noise/temporal-animation"),
)

WAYS = ("white", "turned", "blue")
"""Where numbers come from: the pairs of columns."""

KINDS = ("sample", "samples", "code", "codes", "remap", "remaps")
"""The rows of the picture: what is summed has the plural."""

NOISES = ("number", "triangle", "remapped")
"""A number of the noise in the first frame, the sum of two less 1, and the triangular number of one."""

IMAGES = (*NOISES, *KINDS)
"""The images of a way, (SIZE, SIZE) float32 each."""

FOLDER = "studies/blue_noise"
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")
KERNELS = (f"{FOLDER}/images.comp", f"{FOLDER}/transform.comp")
IMAGE_BYTES = 4 * SIZE**2 * len(WAYS) * len(IMAGES)
LINE_BYTES = 8 * SIZE**2 * len(WAYS) * len(KINDS)
POWER_BYTES = LINE_BYTES // 2

LOW = 0.1
"""Cycles a texel: what lies below is `low` in the counters."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    frames: int = knob(16, "frames whose mean is shown", minimum=1, maximum=FRAMES)
    first: int = knob(0, "number of the first frame", minimum=0, maximum=1 << 20)
    steps: int = knob(4, "steps between codes of the dithered rows", minimum=1, maximum=255)


@dataclass
class NoiseWork(Work):
    """What a frame did."""

    dispatches: int = 0


def work() -> NoiseWork:
    """Return the counters of a frame that are known without the GPU."""
    return NoiseWork(draws=1, triangles=1, dispatches=3)


def defines() -> tuple[tuple[str, int | float], ...]:
    """Return the macros of the shaders."""
    counts = ("WAYS", WAYS), ("KINDS", KINDS), ("NOISES", NOISES), ("IMAGES", IMAGES)
    return (("SIZE", SIZE), *((name, len(names)) for name, names in counts))


def tables() -> NDArray[np.uint32]:
    """Return (2, SIZE, SIZE) words: ranks of white, then of blue noise, two channels of 16 bits each."""
    lots = np.random.default_rng(10)
    white = np.stack([lots.permutation(SIZE**2).reshape(SIZE, SIZE) for _ in range(2)], axis=-1)
    both = np.stack([white, ranks()]).astype(np.uint32)
    words: NDArray[np.uint32] = both[..., 0] | both[..., 1] << np.uint32(16)
    return words


def turns() -> NDArray[np.float32]:
    """Return (SIZE, 2) float32: cosine and minus sine of i / SIZE turns, by which the shader transforms."""
    angle = np.arange(SIZE) * (2 * np.pi / SIZE)
    return np.stack([np.cos(angle), -np.sin(angle)], axis=-1).astype(np.float32)


def push(settings: Settings, columns: bool = False) -> NDArray[np.uint32]:
    """Return the push constants of a kernel, (4,) uint32; `columns` asks the transform for its second half."""
    return np.array([settings.frames, settings.first, settings.steps, columns], np.uint32)


def extent(columns: bool) -> tuple[int, int]:
    """Return the invocations of a half of the transform: a line for each work group, and half of the columns."""
    return SIZE * (SIZE // 2 + 1 if columns else SIZE), len(WAYS) * len(KINDS)


def frequencies() -> NDArray[np.float64]:
    """Return (SIZE, SIZE) cycles a texel of the bins of a spectrum, 0 in the corner."""
    along = np.fft.fftfreq(SIZE)
    return np.hypot(along[:, None], along)


def radial(power: NDArray[np.float32], rings: int = 10) -> NDArray[np.float64]:
    """Return the mean power (..., rings) of rings of equal width between frequencies 0 and 0.5, without 0 itself."""
    at = frequencies()
    ring = np.minimum((at * 2 * rings).astype(int), rings)
    masks = [(ring == number) & (at > 0) for number in range(rings)]
    return np.stack([power[..., mask].mean(axis=-1, dtype=np.float64) for mask in masks], axis=-1)


def told(power: NDArray[np.float32]) -> dict[str, int]:
    """Return counters of spectra (W, K, SIZE, SIZE), in millionths of the variance of one frame: for each row of one
    frame the mean power below LOW cycles a texel (`low`), for each mean over frames that of all bins (`all`)."""
    at = frequencies()
    low = (at > 0) & (at <= LOW)
    counters = {}
    for way, spectra in zip(WAYS, power, strict=True):
        for kind, spectrum in zip(KINDS, spectra, strict=True):
            once = not kind.endswith("s")
            counters[f"{way}_{kind}_{'low' if once else 'all'}"] = round(
                1e6 * float(spectrum[low].mean() if once else spectrum.mean())
            )
    return counters
