"""How far a sequence of frames is from its reference, and what only a sequence shows: flicker, ghosts, lost sharpness.

Frames are (H, W, C) or (H, W): integers are codes of all their bits (0 to 255 of uint8), floats are 0 to 1. Results "in
codes" are on the scale 0 to 255 whatever the frames are. Sums are float64. Sequences are iterables, of which one frame
or two are held at a time. NaN and infinity are refused (`metrics.NonFiniteError`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.errors import UserError
from common.reports import metrics

Array = NDArray[Any]
Float64 = NDArray[np.float64]

CODES = 255.0

FINEST, SCAN = 2.0, 0.02
"""The highest frequency at which `mtf50` looks, and its steps before it halves them, in cycles per pixel."""
WIDEST_GAP = 0.25
"""The largest distance between samples of an edge, in pixels."""


def in_codes(frame: Array) -> Float64:
    """Return a frame in codes: 255 is the largest value of its integers, or 1 of floats."""
    if np.issubdtype(frame.dtype, np.floating):
        return frame.astype(np.float64) * CODES
    return frame.astype(np.float64) * (CODES / np.iinfo(frame.dtype).max)


def psnr(image: Array, reference: Array) -> float:
    """Return the ratio of peak signal to noise in decibels, 10 log10(255^2 / mean squared difference in codes).

    It is infinite for equal pictures. Raises ValueError for different shapes or kinds of numbers.
    """
    a, b = _pair(image, reference)
    mean = float(((a - b) ** 2).mean())
    return math.inf if mean == 0.0 else 10.0 * math.log10(CODES**2 / mean)


@dataclass(frozen=True)
class FrameError:
    """How far one frame is from its reference."""

    frame: int
    max_abs: float
    """The largest difference of a channel, in codes."""
    psnr: float
    """Decibels; infinite for equal frames."""
    relative_mse: float
    """`metrics.relative_mse`, of light where that is given."""
    flip: float | None
    """The mean of FLIP, 0 to 1; None without its package, or where it was not asked for."""


def frame_error(
    frame: int,
    image: Array,
    reference: Array,
    light: tuple[Array, Array] | None = None,
    flip: bool = True,
) -> FrameError:
    """Return how far a frame, as it is shown, is from its reference.

    `light` are both in linear light, of which the relative squared error is taken.
    """
    a, b = _pair(image, reference)
    found = None
    if flip:
        try:
            found = metrics.flip_mean(image, reference)
        except UserError:  # the package is not there
            found = None
    linear = light or (a / CODES, b / CODES)
    return FrameError(
        frame,
        float(np.abs(a - b).max()),
        psnr(image, reference),
        metrics.relative_mse(linear[0], linear[1]),
        found,
    )


class OverTime:
    """The errors of a sequence, gathered frame by frame; only the last error image is held."""

    def __init__(self, flip: bool = True) -> None:
        self.errors: list[FrameError] = []
        self.flicker: list[float] = []
        """Of each frame after the first, as `flicker_over_time` has it."""
        self._flip = flip
        self._before: Float64 | None = None

    def add(self, image: Array, reference: Array, light: tuple[Array, Array] | None = None) -> FrameError:
        """Add the next frame, as it is shown, and its reference; `light` are both in linear light."""
        a, b = _pair(image, reference)
        self.errors.append(frame_error(len(self.errors), image, reference, light, self._flip))
        error = a - b
        if self._before is not None:
            self.flicker.append(flicker_between(self._before, error))
        self._before = error
        return self.errors[-1]

    def worst(self) -> FrameError:
        """Return the first frame with the largest FLIP, or where that is the same or unknown, with the least PSNR."""
        return max(self.errors, key=lambda one: (one.flip or 0.0, -one.psnr))

    def mean(self) -> dict[str, float | None]:
        """Return means over frames by the names of `FrameError`, and "flicker" over pairs of them.

        PSNR is that of the mean squared difference of all frames, which a frame without any does not make infinite.
        """
        count = len(self.errors)
        noise = math.fsum(10.0 ** (-one.psnr / 10.0) for one in self.errors) / count
        flips = [one.flip for one in self.errors if one.flip is not None]
        return {
            "max_abs": math.fsum(one.max_abs for one in self.errors) / count,
            "psnr": math.inf if noise == 0.0 else -10.0 * math.log10(noise),
            "relative_mse": math.fsum(one.relative_mse for one in self.errors) / count,
            "flip": math.fsum(flips) / len(flips) if flips else None,
            "flicker": math.fsum(self.flicker) / len(self.flicker) if self.flicker else None,
        }


def error_over_time(
    frames: Iterable[Array], references: Iterable[Array], flip: bool = True
) -> Iterator[FrameError]:
    """Yield how far each frame, as it is shown, is from its reference; both are of one length (else ValueError)."""
    for index, (frame, reference) in enumerate(zip(frames, references, strict=True)):
        yield frame_error(index, frame, reference, flip=flip)


def flicker_over_time(frames: Iterable[Array], references: Iterable[Array]) -> Iterator[float]:
    """Yield the flicker of each frame after the first, in codes.

    It is the mean, over pixels and channels, of |(f[t] - f[t-1]) - (r[t] - r[t-1])|, with frames f and references r: by
    how much a pixel changes otherwise than it should. An error that stays the same does not flicker, whatever its size;
    the motion of the picture itself is in both differences.
    """
    errors = (a - b for a, b in (_pair(*both) for both in zip(frames, references, strict=True)))
    # (f[t] - r[t]) - (f[t-1] - r[t-1]): only the errors of two frames are held.
    for before, after in pairwise(errors):
        yield flicker_between(before, after)


def flicker_between(before: Float64, after: Float64) -> float:
    """Return the mean absolute change of an error image, in the unit of the images."""
    if before.shape != after.shape:
        raise ValueError(f"frames of different shapes: {before.shape} and {after.shape}")
    return float(np.abs(after - before).mean())


def flicker(frames: Iterable[Array], references: Iterable[Array]) -> float:
    """Return the mean of `flicker_over_time`, in codes. Raises ValueError for fewer than two frames."""
    found = list(flicker_over_time(frames, references))
    if not found:
        raise ValueError("flicker is between frames: there must be two at least")
    return math.fsum(found) / len(found)


@dataclass(frozen=True)
class Ghost:
    """What is left of an object in a frame in which it is no longer seen: differences in codes."""

    most: float
    mean: float
    """Over all pixels and channels that count."""


def ghost(frame: Array, without_object: Array, where: NDArray[np.bool_] | None = None) -> Ghost:
    """Return how far a frame is from the same frame of a sequence in which the object was absent throughout.

    `where` (H, W) are the pixels that count, such as those that the object does not cover now; all of them without it.
    Raises ValueError where none does.
    """
    a, b = _pair(frame, without_object)
    difference = np.abs(a - b)
    if where is not None:
        difference = difference[where]
    if difference.size == 0:
        raise ValueError("no pixel counts")
    return Ghost(float(difference.max()), float(difference.mean()))


def mtf50(rows: ArrayLike, angle: float) -> float:
    """Return the frequency across a slanted edge at which contrast falls to a half, in cycles per pixel.

    `rows` (H, W) is linear light around one straight edge that leads from the top to the bottom, tilted by `angle`
    radians from the vertical (positive: it goes to the right further down); about 3 to 10 degrees are wanted, since
    rows must cross it at many fractions of a pixel. Both sides of the edge are even up to the border.

    As in ISO 12233, the distances of all pixels from the edge, sorted, give one finely sampled edge-spread function.
    Its derivative is the line-spread function, and the Fourier transform of that, 1 at frequency 0, the modulation
    transfer function. Between samples the edge-spread function is a straight line, which makes the transform a sum in
    closed form; gaps of h pixels take sinc(f h)^2 away. Frequencies are along the normal of the edge: a pixel that
    averages its area has |sinc(f cos angle) sinc(f sin angle)|, which is 0.5 at 0.60, and a Gaussian of sigma pixels
    exp(-2 (pi sigma f)^2), which is 0.5 at 0.1874 / sigma.

    It is infinite where contrast is above a half up to `FINEST` cycles per pixel, as at an edge without anti-aliasing.
    Raises ValueError for a picture without an edge, or where rows cross it at too few fractions of a pixel.
    """
    light = np.asarray(rows, np.float64)
    if light.ndim != 2 or min(light.shape) < 4:
        raise ValueError(f"an edge is in a picture (H, W) of 4 pixels at least, not {light.shape}")
    metrics.check_finite(light, "the edge")
    down, right = np.indices(light.shape)
    distance = (right - (down - (light.shape[0] - 1) / 2) * math.tan(angle)) * math.cos(angle)
    # Distances that every row reaches: beyond them there are samples of few rows.
    least, most = float(distance[:, 0].max()), float(distance[:, -1].min())
    if most - least < 4.0:
        raise ValueError("the edge leaves the picture: it must lead from the top to the bottom")
    inside = (distance >= least) & (distance <= most)
    order = np.argsort(distance[inside], kind="stable")
    place, spread = distance[inside][order], light[inside][order]
    if float(np.diff(place).max()) > WIDEST_GAP:
        raise ValueError(
            "rows cross the edge at too few fractions of a pixel: take another angle, or more rows"
        )
    for end in (
        place < least + 1.0,
        place > most - 1.0,
    ):  # contrast is that of both sides, not of two samples
        spread[end] = spread[end].mean()
    step, gap, middle = np.diff(spread), np.diff(place), (place[1:] + place[:-1]) / 2
    contrast = abs(float(spread[-1] - spread[0]))
    if contrast <= 1e-9 * float(np.abs(spread).max(initial=0.0)):
        raise ValueError("the picture has no edge: both of its sides are equally bright")

    def transfer(frequency: float) -> float:
        waves = np.exp(-2j * math.pi * frequency * middle) * np.sinc(frequency * gap)
        return float(abs(waves @ step)) / contrast

    low = 0.0
    for high in np.arange(SCAN, FINEST + SCAN / 2, SCAN):
        if transfer(float(high)) < 0.5:
            break
        low = float(high)
    else:
        return math.inf
    above, below = low, low + SCAN
    for _ in range(30):
        between = (above + below) / 2
        above, below = (between, below) if transfer(between) >= 0.5 else (above, between)
    return (above + below) / 2


def _pair(image: Array, reference: Array) -> tuple[Float64, Float64]:
    """Return both in codes; raises ValueError for different shapes or kinds of numbers."""
    if image.shape != reference.shape:
        raise ValueError(f"pictures of different shapes: {image.shape} and {reference.shape}")
    if image.dtype.kind != reference.dtype.kind and "f" in (image.dtype.kind, reference.dtype.kind):
        raise ValueError(f"pictures of different units: {image.dtype} and {reference.dtype}")
    if image.size == 0:
        raise ValueError(f"a picture without pixels: {image.shape}")
    metrics.check_finite(image, "the picture")
    metrics.check_finite(reference, "the reference")
    return in_codes(image), in_codes(reference)
